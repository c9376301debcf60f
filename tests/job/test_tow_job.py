from typing import Any

import pytest

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.job.tow.job import TowJob

SQUARE = {"outline_mm": [[0, -5000], [2600, -5000], [2600, 5000], [0, 5000]]}
SEAM = {"points_mm": [[2600, -4800], [2600, 4800]], "speed_mm_min": 600}
MOVING = {"speed_mm_min": 600}


def make_job(**tables: Any) -> TowJob:
    return validate_table(TowJob, {"area": SQUARE, "seam": SEAM, **tables})


def test_the_papers_job_is_read_in_metres_and_written_as_it_stood() -> None:
    job = make_job(vehicles={"links": [9, 19, 29, 39, 49, 59]})
    assert job.seam.speed == pytest.approx(0.01)
    assert job.chain.joint_limit == pytest.approx(0.77, abs=1e-3)
    assert job.team.held_links == (9, 19, 29, 39, 49, 59)
    assert validate_table(TowJob, table_to_dict(job)) == job


def test_fifty_vehicles_may_tow_two_hundred_metres() -> None:
    cable = {"length_mm": 200_000, "link_mm": 200, "least_radius_mm": 266}
    hall = {"outline_mm": [[0, -90_000], [90_000, -90_000], [90_000, 90_000], [0, 90_000]]}
    job = make_job(cable=cable, vehicles={"count": 50}, area=hall)
    assert (job.chain.links, len(job.held_links)) == (1000, 50)
    with pytest.raises(ConfigurationError, match="length_mm"):
        make_job(cable={**cable, "length_mm": 200_200}, vehicles={"count": 50}, area=hall)


def test_the_piece_behind_the_welder_may_be_shorter_than_the_others() -> None:
    job = make_job(vehicles={"behind_welder_mm": 600})
    assert job.held_links == (10, 21, 31, 42, 53, 59)
    assert make_job(vehicles={"count": 2, "behind_welder_mm": 600}).held_links == (53, 59)


@pytest.mark.parametrize(
    ("tables", "key", "says"),
    [
        ({"area": {"outline_mm": [[0, 0], [9, 9], [9, 0], [0, 9]]}}, "area.outline_mm", "itself"),
        (
            {"area": {**SQUARE, "holes_mm": [[[2500, 0], [2700, 0], [2600, 99]]]}},
            "area.holes_mm",
            "outline",
        ),
        ({"seam": {"points_mm": [[2600, -5300], [2600, 0]]}}, "seam.points_mm", "300 mm outside"),
        ({"root": {"position_mm": [-50, 0]}}, "root.position_mm", "50 mm outside"),
        ({"seam": {**SEAM, "speed_mm_min": 7000}}, "seam.speed_mm_min", "6000"),
        ({"vehicles": {"count": 20}}, "vehicles.count", "350 mm"),
        ({"vehicles": {"links": [19, 9, 29, 39, 49, 59]}}, "vehicles.links", "rise"),
        ({"vehicles": {"links": [9, 19, 29, 39, 49, 58]}}, "vehicles.links", "last link"),
        (
            {"vehicles": {"links": [9, 19, 29, 39, 49, 59], "behind_welder_mm": 600}},
            "vehicles.behind_welder_mm",
            "vehicles.links",
        ),
        ({"vehicles": {"behind_welder_mm": 5900}}, "vehicles.behind_welder_mm", "rise"),
        ({"vehicles": {"behind_welder_mm": 600, "count": 20}}, "vehicles.count", "350 mm"),
        ({"vehicles": {"behind_welder_mm": 600, "radius_mm": 2e3}}, "vehicles.radius_mm", "4050"),
        (
            {"vehicles": {"behind_welder_mm": 600}, "limits": {"vehicle_gap_mm": 9e3}},
            "limits.vehicle_gap_mm",
            "9300 mm",
        ),
        (
            {"simulation": {"faults": [{"kind": "jammed"}]}},
            "simulation.faults.0.kind",
            "'jam'.*'pose-noise'.*'pose-swap'",
        ),
        ({"vehicles": {"behind_welder_mm": 300}}, "vehicles.behind_welder_mm", "350 mm"),
        ({"seam": {**SEAM, "heading_deg": 1e308}}, "seam.heading_deg", "less than or equal to 360"),
        ({"vehicles": {"links": []}}, "vehicles.links", "6 vehicles, and 0 links"),
        ({"vehicles": {"behind_welder_mm": 650}}, "vehicles.behind_welder_mm", "6.5 times"),
        ({"vehicles": {"behind_welder_mm": 1e-9}}, "vehicles.behind_welder_mm", "whole number"),
        ({"vehicles": {"force_n": 8}}, "vehicles.force_n", "8 N is less than the 8.5 N"),
        ({"limits": {"cable_gap_mm": 9000}}, "limits.cable_gap_mm", "take less than 3820"),
        ({"weights": {"bending": 0}}, "weights.bending", "greater than 0"),
        ({"targets": {"distance_mm": -1}}, "targets.distance_mm", "greater than 0"),
        ({"cable": {"lenght_mm": 6000}}, "cable.lenght_mm", "length_mm"),
        ({"cable": {"length_mm": 6050}}, "cable", "whole number"),
        ({"cable": {"least_radius_mm": 40}}, "cable", "link_mm"),
    ],
)
def test_what_cannot_be_is_refused_by_key_and_reason(
    tables: dict[str, Any], key: str, says: str
) -> None:
    with pytest.raises(ConfigurationError, match=says) as refused:
        make_job(**tables)
    assert refused.value.key == key


def test_a_pillar_on_the_seam_is_refused_with_where() -> None:
    seam = {"points_mm": [[1300, -4000], [1300, 4000]]}
    pillar = [[1200, -100], [1400, -100], [1400, 100], [1200, 100]]
    with pytest.raises(ConfigurationError, match="3900 mm from its beginning") as refused:
        make_job(area={**SQUARE, "holes_mm": [pillar]}, seam=seam)
    assert refused.value.key == "area.holes_mm"


def test_a_pillar_that_touches_the_wall_stands_on_the_seam_there() -> None:
    pillar = [[2400, -100], [2600, -100], [2600, 100], [2400, 100]]
    with pytest.raises(ConfigurationError, match="4700 mm from its beginning") as refused:
        make_job(area={**SQUARE, "holes_mm": [pillar]})
    assert refused.value.key == "area.holes_mm"


def test_a_seam_may_run_along_a_pillar_and_past_an_obstacle() -> None:
    pillar = [[1300, -100], [1500, -100], [1500, 100], [1300, 100]]
    seam = {"points_mm": [[1300, -4000], [1300, 4000]]}
    beside = [{"points_mm": [[1671, 1000]]}, {"points_mm": [[1300, 2000], [0, 0]], **MOVING}]
    assert make_job(area={**SQUARE, "holes_mm": [pillar]}, seam=seam, obstacles=beside)


def test_an_obstacle_beside_the_seam_leaves_room_for_the_welders_body() -> None:
    seam = {"points_mm": [[1300, -4000], [1300, 4000]]}
    jack = {"name": "jack", "points_mm": [[1669, 1000]], "radius_mm": 200}
    with pytest.raises(ConfigurationError, match="jack is 169 mm from the seam") as refused:
        make_job(seam=seam, obstacles=[jack])
    assert refused.value.key == "obstacles.0"


@pytest.mark.parametrize(
    ("place", "says"),
    [
        ([2600, -300], r"jack at \(2600, -300\) mm is on the seam, 4300 mm from"),
        ([100, 0], r"jack at \(100, 0\) mm is on the root, at \(0, 0\) mm"),
    ],
)
def test_an_obstacle_that_stands_on_seam_or_root_is_refused_by_name(
    place: list[float], says: str
) -> None:
    far = {"points_mm": [[1300, 4000], [1300, 4500]], **MOVING}
    jack = {"name": "jack", "points_mm": [place], "radius_mm": 200}
    with pytest.raises(ConfigurationError, match=says) as refused:
        make_job(obstacles=[far, jack])
    assert refused.value.key == "obstacles.1"


@pytest.mark.parametrize(
    ("fault", "field", "says"),
    [
        ({"kind": "jam", "vehicle": 9}, "vehicle", "jam is to happen to number 9 of 6 vehicles"),
        ({"kind": "push", "vehicle": 7}, "vehicle", "6 vehicles"),
        ({"kind": "pose-lost", "vehicle": 9}, "vehicle", "6 vehicles"),
        ({"kind": "passer-by-stands", "vehicle": 2}, "vehicle", "number 2 of 1 moving obstacle"),
        ({"kind": "jam", "for_s": -4}, "for_s", "greater than 0"),
    ],
)
def test_a_fault_of_what_is_not_there_is_refused(
    fault: dict[str, Any], field: str, says: str
) -> None:
    obstacles = [{"points_mm": [[1300, 4000]]}, {"points_mm": [[0, 0], [2000, 0]], **MOVING}]
    right = {"kind": "passer-by-stands", "vehicle": 1, "for_s": 3}
    with pytest.raises(ConfigurationError, match=says) as refused:
        make_job(obstacles=obstacles, simulation={"faults": [right, fault]})
    assert refused.value.key == f"simulation.faults.1.{field}"


def test_nobody_can_stand_who_does_not_pass_by() -> None:
    with pytest.raises(ConfigurationError, match="0 moving obstacles"):
        make_job(simulation={"faults": [{"kind": "passer-by-stands"}]})


def test_a_corridor_that_no_vehicle_passes_is_refused_with_its_width() -> None:
    # Two rooms, and a corridor of 300 mm between them that is longer than a piece of cable.
    rooms = [
        [0, -500], [1500, -500], [1500, -150], [3500, -150], [3500, -1000], [5000, -1000],
        [5000, 1000], [3500, 1000], [3500, 150], [1500, 150], [1500, 500], [0, 500],
    ]  # fmt: skip
    seam = {"points_mm": [[4800, -900], [4800, 900]]}
    with pytest.raises(ConfigurationError, match=r"300 mm wide at most, and need 340") as refused:
        make_job(area={"outline_mm": rooms}, seam=seam)
    assert refused.value.key == "area.outline_mm"
    assert make_job(area={"outline_mm": rooms}, seam=seam, vehicles={"radius_mm": 120})


def test_simulated_vehicles_are_as_stated_and_else_as_the_job_has_them() -> None:
    """So a simulation may differ from what the planner is told."""
    from tjscan.job.tow.simulation import towing_world_of_job

    vehicles = {"radius_mm": 120, "force_n": 30}
    world = towing_world_of_job(make_job(vehicles=vehicles)).vehicle
    assert (world.body_radius, world.force) == (0.12, 30.0)
    truly = {"towing_vehicle": {"body_radius_mm": 200, "force_n": 12}}
    world = towing_world_of_job(make_job(vehicles=vehicles, simulation=truly)).vehicle
    assert (world.body_radius, world.force) == (0.2, 12.0)
    usual = {"towing_vehicle": {"body_radius_mm": 150, "force_n": 60}}
    world = towing_world_of_job(make_job(vehicles=vehicles, simulation=usual)).vehicle
    assert (world.body_radius, world.force) == (0.15, 60.0)
