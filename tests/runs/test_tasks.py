import pytest

from tjscan.runs.tasks import ALL_TASKS, Task


@pytest.mark.parametrize("task", ALL_TASKS, ids=lambda task: task.name)
def test_every_contribution_of_a_task_can_be_loaded(task: Task) -> None:
    assert callable(task.load("chapter"))
    assert callable(task.load("show"))
    assert not task.page or callable(task.load("page"))
    assert not task.study or task.load("study").measures
