"""Chromium without a window and without a network, driven by Playwright: for tests and pictures."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ConsoleMessage, Page

_OPTIONS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # WebGL without a graphics card.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
PATIENCE_MS = 120_000
"""A machine without a graphics card, busy with other work, draws a picture in many seconds."""


def why_missing() -> str | None:
    """What is not installed, or None if a browser can be started."""
    if importlib.util.find_spec("playwright") is None:
        return "playwright is not installed: pip install playwright"
    if shutil.which("chromium") is None:
        return "Chromium is not installed: apt-get install chromium"
    return None


@dataclass
class OpenPage:
    """One page, and what went wrong in it."""

    page: Page
    errors: list[str] = field(default_factory=list)
    """Errors on its console, exceptions that nobody caught, addresses outside of this machine."""

    warnings: list[str] = field(default_factory=list)
    """Warnings on its console, but for the driver's on pixels that are read back."""

    def note(self, message: ConsoleMessage) -> None:
        """Keep an error or a warning of the console."""
        if message.type == "error":
            self.errors.append(message.text)
        elif message.type == "warning" and "GL Driver Message" not in message.text:
            self.warnings.append(message.text)


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser; at most one at a time in a process."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=path, args=list(_OPTIONS))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def open_page(
    browser: Browser, address: str, width_px: int = 900, height_px: int = 600, before: str = ""
) -> Iterator[OpenPage]:
    """A page; addresses on other machines than its own are not reached, and are errors.

    Parameters
    ----------
    before : a script that the page runs before its own.
    """
    page = browser.new_page(viewport={"width": width_px, "height": height_px})
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(before)
    opened = OpenPage(page)
    page.on("console", opened.note)
    page.on("pageerror", lambda error: opened.errors.append(str(error)))
    page.on("requestfailed", lambda request: opened.errors.append(f"no {request.url}"))
    host = _host(address)
    page.route(
        lambda url: url.startswith("http") and _host(url) != host, lambda route: route.abort()
    )
    page.goto(address)
    try:
        yield opened
    finally:
        page.close()


def _host(address: str) -> str:
    return address.split("/")[2].partition(":")[0]
