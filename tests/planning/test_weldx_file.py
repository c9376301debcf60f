"""The plan as a weldx file, read again by weldx."""

from pathlib import Path

import numpy as np
import pytest
from plates import half_v
from ringed_grooves import edges_of

from tjscan.core.provenance import Provenance
from tjscan.planning.document import plan_document
from tjscan.planning.plan import plan_weld
from tjscan.planning.weldx_file import write_plan_as_weldx
from tjscan.planning.wps import read_wps

WPS = Path(__file__).parent.parent.parent / "examples" / "wps.toml"


# weldx leaves files to the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_weldx_reads_the_beads_again(tmp_path: Path) -> None:
    weldx = pytest.importorskip("weldx", reason="the extra tjscan[weldx] is not installed")
    flat = half_v()
    corners = np.stack(
        np.broadcast_arrays(np.linspace(0, 0.1, 8)[:, None], flat[:, 0], flat[:, 1]), axis=2
    )
    plan = plan_weld(edges_of(corners), read_wps(WPS), np.array((0.0, -1.0, 0.0)))
    document = plan_document(
        plan, Provenance.for_file_written_now("job", "j", "mm"), "run", plan.wps.name
    )
    file = tmp_path / "plan.weldx"
    write_plan_as_weldx(file, plan, document, "joint")
    with weldx.WeldxFile(file, mode="r") as made:
        assert made["plan"] == document.model_dump(mode="json")
        frames = made["coordinate_systems"]
        assert len(frames.coordinate_system_names) == 1 + len(plan.beads)
        for bead, told in zip(plan.beads, made["beads"], strict=True):
            torch = frames.get_cs(f"torch, bead {bead.number}", "joint")
            np.testing.assert_allclose(
                torch.coordinates.data.to("m").magnitude, bead.points, atol=1e-9
            )
            np.testing.assert_allclose(torch.orientation.data, bead.T_r_torch[:, :3, :3], atol=1e-9)
            speed = told["travel_speed"]
            np.testing.assert_allclose(speed.data.to("m/s").magnitude, bead.speed, rtol=1e-9)
            # The way that it goes at this speed is the bead's length, in another's clock.
            time = speed.time.as_quantity().to("s").magnitude
            np.testing.assert_allclose(time, bead.times, atol=2e-9 + 1e-9 * bead.arc_time)
