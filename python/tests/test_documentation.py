"""The Python of docs/python.md runs as it stands."""

import re

import pytest

from conftest import REPOSITORY

PAGE = (REPOSITORY / "docs" / "python.md").read_text()


def test_every_block_runs(monkeypatch, tmp_path):
    blocks = [block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "__main__" not in block]
    assert len(blocks) >= 4
    (tmp_path / "scenarios").symlink_to(REPOSITORY / "scenarios")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)  # noqa: S102
    assert names["flight"].summary.lost is None
    assert names["simulation"].done
    assert (tmp_path / "runs" / "from-python" / "run.mcap").exists()
    assert names["flown"].rate("survived", law="indi").flown == 50


def test_every_block_about_learning_runs(monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    page = (REPOSITORY / "docs" / "learning.md").read_text()
    names = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "docs/learning.md", "exec"), names)  # noqa: S102
    assert names["observations"].shape == (64, 18)


@pytest.mark.parametrize("name", ["python/tests", "tests/python/run.sh", "examples/notebook/comparison.ipynb", "examples/python_controller"])
def test_what_the_page_names_is_there(name):
    assert (REPOSITORY / name).exists()
