"""A real browser for tests of pages: the Chromium that is installed, without a window."""

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

PATIENCE = 300_000  # Rendering in software is slow, and tests share the cores, [ms].


@contextmanager
def browser() -> Iterator[Any]:
    """A browser: the system's, or else Playwright's own.

    Where there is none the test is skipped; on the hosted Linux machines, which install one in
    .github/workflows/tests.yml, it fails.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with playwright.sync_playwright() as started:
        if chromium is None and not Path(started.chromium.executable_path).exists():
            is_hosted = os.environ.get("RUNNER_ENVIRONMENT") == "github-hosted"
            give_up = pytest.fail if is_hosted and sys.platform == "linux" else pytest.skip
            give_up("no chromium is installed: `python -m playwright install chromium`")
        arguments = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
        opened = started.chromium.launch(executable_path=chromium, args=arguments)
        yield opened
        opened.close()


def page_at(opened: Any, url: str, *, width: int = 500, dark: bool = False) -> Any:
    """A small page of a browser at an address."""
    scheme = "dark" if dark else "light"
    page = opened.new_page(viewport={"width": width, "height": 400}, color_scheme=scheme)
    page.set_default_timeout(PATIENCE)
    page.goto(url)
    return page


@contextmanager
def opened_page(url: str, *, width: int = 500, dark: bool = False) -> Iterator[Any]:
    """A small page at an address; the test is skipped where no browser is there."""
    with browser() as opened:
        yield page_at(opened, url, width=width, dark=dark)
