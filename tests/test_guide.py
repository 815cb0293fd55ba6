"""The pages are a guide in which every link leads somewhere."""

from pathlib import Path

from sphinx.cmd.build import build_main

DOCS = Path(__file__).parents[1] / "docs"


def test_the_guide_is_made_without_a_warning(tmp_path: Path) -> None:
    pages = tmp_path / "pages"
    options = [
        "-b",
        "html",
        "-t",
        "pages",
        "-W",
        "--keep-going",
        "-q",
        "-d",
        str(tmp_path / "read"),
    ]
    assert build_main([*options, str(DOCS), str(pages)]) == 0
    assert "Tutorial" in (pages / "index.html").read_text()
