"""The pictures of README, start.md and concepts.md, made by the code on those pages: `python docs/pictures.py`."""

import os
import re
import shutil
import tempfile
from pathlib import Path

DOCS = Path(__file__).parent
MADE = {  # what the code of a page writes, and what the page shows
    "../README": {"four_bar.png": "readme_four_bar.png"},
    "start": {"wiper.png": "start_drawn.png", "moved.png": "start_moved.png", "best.png": "start_best.png"},
    "concepts": {f"{name}.png": f"concepts_{name}.png" for name in ("natural", "branches", "failure", "gradient")},
}


def main() -> None:
    """Run the pages and copy their pictures."""
    for page, pictures in MADE.items():
        text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            space: dict = {}
            for code in re.findall(r"```python\n(.*?)```", text, re.S):
                exec(compile(code, f"{page}.md", "exec"), space)
            for made, shown in pictures.items():
                shutil.copy(made, DOCS / shown)
            os.chdir(DOCS)


if __name__ == "__main__":
    main()
