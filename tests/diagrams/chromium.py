"""A real browser for tests of pages: the Chromium that is installed, without a window."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

PATIENCE = 120_000  # Rendering in software is slow, [ms].


@contextmanager
def opened_page(url: str, *, width: int = 500, dark: bool = False) -> Iterator[Any]:
    """A small page at an address; the test is skipped where no browser is there."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no chromium is installed")
    with playwright.sync_playwright() as started:
        arguments = ["--use-angle=swiftshader", "--no-sandbox"]
        browser = started.chromium.launch(executable_path=chromium, args=arguments)
        scheme = "dark" if dark else "light"
        page = browser.new_page(viewport={"width": width, "height": 400}, color_scheme=scheme)
        page.set_default_timeout(PATIENCE)
        page.goto(url)
        yield page
        browser.close()
