"""Against another solver's best shapes of random problems."""

from _towing_plans import optimum_rows


def test_shapes_are_as_good_as_the_best_that_another_solver_found() -> None:
    for row in optimum_rows():
        assert row.holds, row
