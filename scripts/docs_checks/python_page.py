"""Run the Python examples of a page one after the other, by doctest."""

import contextlib
import doctest
import io
import re
from collections.abc import Iterator
from pathlib import Path

_FENCE = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)

_OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def check_python(page: Path, folder: Path, /) -> Iterator[str]:
    """Run the examples of a page in a folder, in one namespace, and yield the differences from what the page shows."""
    text = page.read_text(encoding="utf-8")
    examples = "\n".join(_FENCE.findall(text))
    if ">>>" not in examples:
        yield f"{page}: no examples"
        return
    namespace: dict[str, object] = {}
    told = io.StringIO()
    with contextlib.chdir(folder):
        test = doctest.DocTestParser().get_doctest(examples, namespace, page.name, str(page), 0)
        doctest.DocTestRunner(optionflags=_OPTIONS, verbose=False).run(test, out=told.write)
    if told.getvalue():
        yield f"{page}: {told.getvalue().strip()}"
