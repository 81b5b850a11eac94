"""Run notebooks as Jupyter does, cell by cell in one namespace. A cell shows its text, its last value and its figures."""

import ast
import base64
import contextlib
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docs_checks.printed import differences


def check_notebook(path: Path, /) -> Iterator[str]:
    """Run a notebook in its own folder, and yield the differences between the outputs of its cells and the stored outputs."""
    document = json.loads(path.read_text(encoding="utf-8"))
    before = [cell.get("outputs", []) for cell in document["cells"]]
    run_notebook(document, path.parent)
    for number, (cell, expected) in enumerate(zip(document["cells"], before, strict=True)):
        found = cell.get("outputs", [])
        if [sorted(one.get("data", {})) for one in found] != [sorted(one.get("data", {})) for one in expected]:
            yield f"{path}: cell {number} shows other kinds of things than it says"
        for difference in differences(_text(expected), _text(found)):
            yield f"{path}: cell {number}: {difference}"


def write_notebook(path: Path, /) -> None:
    """Run a notebook, and store the outputs of its cells."""
    document = json.loads(path.read_text(encoding="utf-8"))
    run_notebook(document, path.parent)
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def run_notebook(document: dict[str, Any], folder: Path, /) -> None:
    """Run the cells of a notebook in a folder, and replace their outputs.

    Raises:
        Exception: whatever a cell raises.
    """
    import matplotlib

    matplotlib.use("agg")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    cells = (cell for cell in document["cells"] if cell["cell_type"] == "code")
    with contextlib.chdir(folder):
        for count, cell in enumerate(cells, start=1):
            cell["execution_count"] = count
            cell["outputs"] = list(_outputs("".join(cell["source"]), namespace, count))


def _outputs(source: str, namespace: dict[str, Any], count: int) -> Iterator[dict[str, Any]]:
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), namespace)
    if printed.getvalue():
        yield {"output_type": "stream", "name": "stdout", "text": printed.getvalue().splitlines(keepends=True)}
    if value is not None and not source.rstrip().endswith(";"):
        text = repr(value).splitlines(keepends=True)
        yield {"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": {"text/plain": text}}
    yield from _figures()


def _figures() -> Iterator[dict[str, Any]]:
    from matplotlib import pyplot

    for number in pyplot.get_fignums():
        picture = io.BytesIO()
        pyplot.figure(number).savefig(picture, format="png", dpi=60, metadata={"Software": None})
        pyplot.close(number)
        coded = base64.b64encode(picture.getvalue()).decode()
        shown = {"image/png": coded, "text/plain": ["<Figure>"]}
        yield {"output_type": "display_data", "metadata": {}, "data": shown}


def _text(outputs: list[dict[str, Any]]) -> str:
    """Return the text of some outputs."""
    parts = [one.get("text") or one.get("data", {}).get("text/plain", []) for one in outputs]
    return "".join("".join(part) for part in parts)
