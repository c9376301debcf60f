"""On CI, which installs everything that tests need, a skip is a failure."""

import pytest

REASON = ("test_x.py", 1, "Skipped: no broker on this machine")
MISSING = ("test_x.py", 1, "Skipped: the recorded lines are no part of the project; none at /x")


@pytest.mark.parametrize(
    ("ci", "reason", "outcome"),
    [("1", REASON, "failed"), ("1", MISSING, "skipped"), ("", REASON, "skipped")],
    ids=["on CI", "missing recorded data", "elsewhere"],
)
def test_a_skip_fails_on_ci_but_for_missing_data(
    ci: str,
    reason: tuple[str, int, str],
    outcome: str,
    monkeypatch: pytest.MonkeyPatch,
    pytestconfig: pytest.Config,
) -> None:
    monkeypatch.setenv("CI", ci)
    plugins = pytestconfig.pluginmanager.get_plugins()
    (conftest,) = (plugin for plugin in plugins if hasattr(plugin, "fail_skip"))
    report = pytest.TestReport("x", ("x", 0, "x"), {}, "skipped", reason, "call")
    conftest.fail_skip(report)
    assert report.outcome == outcome
