"""Every link between the documents leads to a file, and to a heading that it has."""

import re
from pathlib import Path

import pytest
from documented import DOCUMENTS, ROOT, without_blocks

LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


def anchors(document: Path) -> set[str]:
    """Anchors of a document's headings, as pages of the site and of a forge have them."""
    headings = re.findall(r"^#+ (.*)$", without_blocks(document), re.MULTILINE)
    words = (re.sub(r"[^\w\s-]", "", heading.lower()) for heading in headings)
    return {re.sub(r"\s", "-", heading.strip()) for heading in words}


def links(document: Path) -> list[str]:
    """What a document links to inside the project."""
    targets: list[str] = LINK.findall(without_blocks(document))
    return [target for target in targets if "://" not in target]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_no_link_is_dead(document: Path) -> None:
    for target in links(document):
        name, _, anchor = target.partition("#")
        file = document.parent / name if name else document
        assert file.exists(), target
        if anchor:
            assert anchor in anchors(file), target


def test_every_page_is_reached_from_the_first() -> None:
    reached, left = set[Path](), [ROOT / "README.md"]
    while left:
        document = left.pop()
        reached.add(document)
        files = {
            (document.parent / target.partition("#")[0]).resolve() for target in links(document)
        }
        left += [file for file in files if file.suffix == ".md" and file not in reached]
    assert {file.name for file in DOCUMENTS} <= {file.name for file in reached}


def test_every_page_stands_in_the_menu() -> None:
    menu = re.findall(
        r"- (?:[\w ]+: )?([\w./-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE
    )
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert pages <= {*menu}
    assert len(menu) == len({*menu})
