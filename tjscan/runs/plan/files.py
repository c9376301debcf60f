"""The files that every plan leaves, and whose fault it is where there is none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tjscan.core.errors import ConfigurationError
from tjscan.core.provenance import Provenance
from tjscan.planning.document import PlanDocument
from tjscan.planning.plan import WeldPlan
from tjscan.planning.tables import beads_to_csv
from tjscan.planning.weldx_file import weldx_is_installed, write_plan_as_weldx
from tjscan.planning.wps import WeldingProcedure
from tjscan.result.export import ROOTS

PLAN: Final = "plan.json"
BEADS: Final = "beads.csv"
PICTURE: Final = "plan.png"
WELDX: Final = "plan.weldx"
CRAWL_PASSES: Final = "plan-passes.toml"
"""Tables that a crawl job takes."""

EARLIER: Final = ("plan.urscript", "plan-*.urscript", CRAWL_PASSES, WELDX, "plan.html")
"""Not every plan has them: those of an earlier one do not stay beside a new one."""


def write_plan_files(
    draft: Path, plan: WeldPlan, document: PlanDocument, provenance: Provenance
) -> None:
    """Write picture, table and document of a plan, and the weldx file where weldx is installed.

    Parameters
    ----------
    draft : Path
        Directory that becomes the plan's.
    plan : WeldPlan
        The plan.
    document : PlanDocument
        As it stands in ``plan.json``.
    provenance : Provenance
        Of all of them.
    """
    from tjscan.planning.picture import draw_plan
    from tjscan.result.picture import write_png

    write_png(draft / PICTURE, draw_plan(plan), provenance)
    table = beads_to_csv(plan, provenance)
    (draft / BEADS).write_text(table, encoding="utf-8", newline="")
    if weldx_is_installed():
        root = ROOTS.get(provenance.frame, provenance.frame)
        write_plan_as_weldx(draft / WELDX, plan, document, root)
    (draft / PLAN).write_text(document.model_dump_json(indent=1) + "\n", encoding="utf-8")


@contextmanager
def add_file_of_key(wps_file: Path, sections: Path) -> Iterator[None]:
    """Add to errors of the block the file that their key stands in: the WPS, or the sections.

    An option of the command line stands in no file.
    """
    try:
        yield
    except ConfigurationError as error:
        key = error.key or ""
        of_wps = key.split(".")[0] in WeldingProcedure.model_fields
        file = error.file or (wps_file if of_wps else sections)
        raise ConfigurationError(
            error.message, file=None if key.startswith("--") else file, key=error.key
        ) from None
