"""Which licences are permitted, and that those of the installed packages are."""

import pytest
from licences import is_permitted, licences


@pytest.mark.parametrize(
    ("licence", "permitted"),
    [
        ("MIT", True),
        ("BSD 3-Clause License", True),
        ("GNU Lesser General Public License v3 (LGPLv3)", True),
        ("LGPL-2.1-or-later", True),
        ("GPL-3.0-only", False),
        ("GNU General Public License v2 (GPLv2)", False),
        ("AGPL-3.0", False),
        ("MIT AND GPL-2.0", False),
        ("EPL-2.0 OR BSD-3-Clause", True),
        ("Other/Proprietary License", False),
        ("see LICENSE", False),
        ("", False),
    ],
)
def test_nothing_stronger_than_the_lgpl_is_permitted(licence: str, permitted: bool) -> None:
    assert is_permitted(licence) is permitted


def test_everything_installed_is_permitted() -> None:
    assert [name for name, _, licence in licences() if not is_permitted(licence)] == []
