"""Debian's Chromium without a window, driven by selenium: it opens files, points, drags and takes screenshots."""

import base64
import importlib
import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.needed import needed_module, needed_program

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)

READY = "return document.documentElement.dataset.ready"


class Browser:
    """A browser with one page in it."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, page: Path, *, width: int = 1440, height: int = 1000, dark: bool = False, media: str = "") -> None:
        """Open a page from a file and wait until it is ready."""
        self.look(width=width, height=height, dark=dark, media=media)
        self.driver.get(page.as_uri())
        self.wait(READY)

    def look(self, *, width: int = 1440, height: int = 1000, dark: bool = False, media: str = "") -> None:
        """Set the size of the window, the light or dark colour scheme, and the medium, such as print."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.tell("Emulation.setDeviceMetricsOverride", **size)
        self.tell("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def tell(self, command: str, /, **arguments: Any) -> Any:
        """Give the browser a command of its debugging protocol."""
        return self.driver.execute_cdp_cmd(command, arguments)

    def run(self, script: str, *arguments: Any) -> Any:
        """Return what a script returns."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str, *arguments: Any) -> Any:
        """Wait until a script returns a true value, and return it."""
        waiting = importlib.import_module("selenium.webdriver.support.ui").WebDriverWait(self.driver, 20, 0.02)
        return waiting.until(lambda driver: driver.execute_script(script, *arguments))

    def settle(self) -> None:
        """Wait until the browser has drawn all changes."""
        done = "requestAnimationFrame(() => requestAnimationFrame(() => arguments[arguments.length - 1]()))"
        self.driver.execute_async_script(done)

    def find(self, css: str) -> Any:
        """Return the first element that a selector names."""
        return self.driver.find_element("css selector", css)

    def all(self, css: str) -> list[Any]:
        """Return the elements that a selector names."""
        return list(self.driver.find_elements("css selector", css))

    def click(self, css: str) -> None:
        """Click on an element."""
        element = self.find(css)
        self.run("arguments[0].scrollIntoView({block: 'center'})", element)
        element.click()
        self.settle()

    def point(self, css: str, *shares: tuple[float, float], drag: bool = False) -> None:
        """Move the pointer over places of an element, given as shares of its size; `drag`: with the button held down."""
        element = self.find(css)
        self.run("arguments[0].scrollIntoView({block: 'center'})", element)
        width, height = self.run(
            "const box = arguments[0].getBoundingClientRect(); return [box.width, box.height]", element
        )
        chains = importlib.import_module("selenium.webdriver.common.action_chains").ActionChains
        moves = chains(self.driver, duration=10)
        for number, (x, y) in enumerate(shares):
            moves.move_to_element_with_offset(element, round((x - 0.5) * width), round((y - 0.5) * height))
            if drag and number == 0:
                moves.click_and_hold()
        (moves.release() if drag else moves).perform()
        self.settle()

    def press(self, css: str, *keys: str) -> None:
        """Give an element the focus and press keys by selenium's names."""
        known = importlib.import_module("selenium.webdriver.common.keys").Keys
        element = self.find(css)
        self.run("arguments[0].focus()", element)
        for key in keys:
            element.send_keys(getattr(known, key, key))
        self.settle()

    def picture(self, css: str) -> NDArray[np.uint8]:
        """Return a screenshot of an element, RGB."""
        from PIL import Image

        element = self.find(css)
        self.run("arguments[0].scrollIntoView({block: 'center'})", element)
        self.settle()
        with Image.open(io.BytesIO(element.screenshot_as_png)) as image:
            return np.asarray(image.convert("RGB"))

    def printed(self) -> bytes:
        """Return the page as it is printed, a PDF."""
        return base64.b64decode(self.tell("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)["data"])

    def complaints(self) -> list[str]:
        """Return the messages in the browser's log since the last call."""
        return [f"{entry['level']}: {entry['message']}" for entry in self.driver.get_log("browser")]


@contextmanager
def opened_browser(profile: Path) -> Iterator[Browser]:
    """Start Chromium with its own profile; without Chromium the test is skipped, but fails under CI."""
    chromium, chromedriver = needed_program("chromium"), needed_program("chromedriver")
    webdriver, service = needed_module("selenium.webdriver"), needed_module("selenium.webdriver.chrome.service")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    # Chromium makes a socket in the temporary folder, and the system takes no socket with a path of 108 letters
    folder = tempfile.gettempdir() if len(tempfile.gettempdir()) < 60 else "/tmp"
    server = service.Service(chromedriver, env={**os.environ, "TMPDIR": folder})
    driver = webdriver.Chrome(options=options, service=server)
    try:
        yield Browser(driver)
    finally:
        driver.quit()
