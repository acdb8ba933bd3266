"""Run notebooks and store their outputs: ``python notebooks/run.py [NAME.ipynb ...]``, all if none is named.

Each runs in a process of its own, from top to bottom, and is written with what it showed; nothing else in the file
changes, so that what is stored differs only where results do. A cell is plain Python: what it prints, what its last
line is unless that ends in a semicolon, and the figures of pyplot that it leaves open are its outputs.
"""

import ast
import base64
import contextlib
import io
import json
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
COLOURS = 64  # of a stored picture
DPI = 90.0  # of figures of pyplot


def png(thing) -> bytes:
    """The picture that a notebook shows of a thing; none is b""."""
    from matplotlib.figure import Figure

    if hasattr(thing, "_repr_png_"):
        return thing._repr_png_()
    if not isinstance(thing, Figure):
        return b""
    data = io.BytesIO()
    thing.savefig(data, format="png", dpi=DPI, bbox_inches="tight")
    return data.getvalue()


def small(picture: bytes) -> str:
    """A picture of few colours, without a word of what made it, as a notebook stores it."""
    from PIL import Image

    data = io.BytesIO()
    pixels = Image.open(io.BytesIO(picture)).convert("RGB")
    pixels.quantize(COLOURS, dither=Image.Dither.NONE).save(data, "PNG", optimize=True)
    return base64.b64encode(data.getvalue()).decode() + "\n"


class Shown(io.TextIOBase):
    """What a cell shows, in the order in which it does; also the stream that it prints to."""

    def __init__(self):
        self.outputs: list[dict] = []

    def write(self, text: str) -> int:
        """Take what is printed."""
        if text and not (self.outputs and self.outputs[-1]["output_type"] == "stream"):
            self.outputs.append({"name": "stdout", "output_type": "stream", "text": ""})
        if text:
            self.outputs[-1]["text"] += text
        return len(text)

    def show(self, *things) -> None:
        """Show things as pictures, pages or words."""
        for thing in things:
            data = {}
            if picture := png(thing):
                data["image/png"] = small(picture)
            elif hasattr(thing, "_repr_html_") and (page := thing._repr_html_()):
                data["text/html"] = page
            data["text/plain"] = f"<{type(thing).__name__}>" if data else repr(thing)
            self.outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})

    def close_figures(self) -> None:
        """Show the figures of pyplot that are open, and close them."""
        if "matplotlib.pyplot" not in sys.modules:
            return
        import matplotlib.pyplot as plt

        for number in plt.get_fignums():
            self.show(plt.figure(number))
        plt.close("all")


def run(notebook: dict, name: str = "notebook") -> list[list[dict]]:
    """Run all code cells of a notebook in one namespace.

    Returns:
        The outputs of each code cell.

    Raises:
        RuntimeError: a cell wrote to stderr; what a cell raises goes through, with its cell's number in a note.
    """
    import matplotlib

    matplotlib.use("agg")
    Shown().close_figures()  # of the program that calls this
    space: dict = {"__name__": "__main__"}
    every = []
    for number, cell in enumerate((c for c in notebook["cells"] if c["cell_type"] == "code"), 1):
        source, shown, complaints = "".join(cell["source"]), Shown(), io.StringIO()
        space["display"] = shown.show
        tree = ast.parse(source, f"{name}, cell {number}")
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        try:
            with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(complaints):
                exec(compile(tree, f"{name}, cell {number}", "exec"), space)
                if isinstance(last, ast.Expr):
                    value = eval(compile(ast.Expression(last.value), f"{name}, cell {number}", "eval"), space)
                    if value is not None and not source.rstrip().endswith(";"):
                        shown.show(value)
                shown.close_figures()
        except Exception as error:
            error.add_note(f"in {name}, cell {number}:\n{source}")
            raise
        if complaints.getvalue():
            raise RuntimeError(f"{name}, cell {number} wrote to stderr: {complaints.getvalue()}")
        every.append(shown.outputs)
    return every


def store(path: Path) -> None:
    """Run a notebook and write it with its outputs, and without anything that changes from run to run."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    start, used = time.perf_counter(), time.process_time()
    every = run(notebook, path.name)
    start, used = time.perf_counter() - start, time.process_time() - used
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, (cell, outputs) in enumerate(zip(code, every, strict=True), 1):
        lines = [{**o, "text": o["text"].splitlines(keepends=True)} if "text" in o else o for o in outputs]
        cell["outputs"], cell["execution_count"] = lines, number
    for number, cell in enumerate(notebook["cells"], 1):
        cell["id"] = f"cell-{number:02d}"
        cell["source"] = "".join(cell["source"]).splitlines(keepends=True)
        cell["metadata"] = {key: kept for key, kept in cell["metadata"].items() if key == "tags"}
    notebook["metadata"] = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    notebook["nbformat"], notebook["nbformat_minor"] = 4, 5
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    print(f"{path.name:40s} {start:6.1f} s, of the processor {used:6.1f} s, {path.stat().st_size // 1024:5d} KiB")


def main(names: list[str]) -> int:
    """Store the notebooks of these names, each by a process of its own; "--show" prints what one shows, as JSON."""
    if names[:1] == ["--show"]:
        os.chdir(HERE)
        print(json.dumps(run(json.loads((HERE / names[1]).read_text(encoding="utf-8")), names[1])))
        return 0
    if names[:1] == ["--one"]:
        os.chdir(HERE)
        store(HERE / names[1])
        return 0
    paths = [HERE / Path(name).name for name in names] or sorted(HERE.glob("*.ipynb"))
    alone = [sys.executable, __file__, "--one"]
    failed = [path.name for path in paths if subprocess.run([*alone, path.name], check=False).returncode]
    if failed:
        print("failed:", *failed, file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
