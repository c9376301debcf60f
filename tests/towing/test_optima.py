"""Against another solver's best shapes of random problems."""

from _towing_plans import cold_start_rows, optimum_rows


def test_shapes_are_as_good_as_the_best_that_another_solver_found() -> None:
    for row in optimum_rows():
        assert row.holds, row


def test_the_first_shape_is_as_good_as_the_best_of_many_random_starts() -> None:
    """Of the problems with many local optima, in which the first shape was worst."""
    for row in cold_start_rows(slice(9, 11)):
        assert row.holds, row
