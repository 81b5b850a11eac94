"""The Python examples on pages and in the notebook run, and print what is said there."""

import json
from pathlib import Path
from typing import Any

import pytest
from docs_checks.notebook import check_notebook, run_notebook
from docs_checks.python_page import check_python

from tests.support.needed import needed_module
from tests.support.run_cadtof import ROOT


@pytest.mark.parametrize("page", ["python.md", "physics.md"])
def test_the_examples_of_a_page_print_what_it_says(page: str) -> None:
    needed_module("xarray")
    assert not list(check_python(ROOT / "docs" / page, ROOT))


def test_nothing_is_wrong_with_the_notebook() -> None:
    needed_module("xarray")
    assert not list(check_notebook(ROOT / "docs" / "python.ipynb"))


def test_examples_that_print_something_else_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\n>>> 1 + 1\n3\n\n```\n")
    assert "Expected:\n    3\nGot:\n    2" in next(check_python(page, tmp_path))
    page.write_text("no examples\n")
    assert list(check_python(page, tmp_path)) == [f"{page}: no examples"]
    cell: dict[str, Any] = {
        "cell_type": "code",
        "metadata": {},
        "source": ["print('depth', 1.00)\n", "2"],
        "outputs": [],
    }
    document = {"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 4}
    run_notebook(document, tmp_path)
    assert [one["output_type"] for one in cell["outputs"]] == ["stream", "execute_result"]
    notebook = tmp_path / "book.ipynb"
    notebook.write_text(json.dumps(document))
    assert not list(check_notebook(notebook))
    notebook.write_text(json.dumps(document).replace("depth 1.0", "depth 1.3"))
    (problem,) = check_notebook(notebook)
    assert "expected 'depth 1.3" in problem
    with pytest.raises(ZeroDivisionError):
        run_notebook({"cells": [{"cell_type": "code", "source": ["1 / 0"]}]}, tmp_path)
