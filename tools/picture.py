"""Take the README's picture: the page in Chromium while the robot works and a Temi stands in its way.

Usage: python tools/picture.py docs/page.png [--scene exp2] [--at 18]   (needs the dev extra and a Chromium)
"""

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from motm_twin.bus.client import TwinClient
from motm_twin.bus.health import page_answers
from motm_twin.bus.session import free_port

FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> int:
    """Serve, wait for the moment, close the notices, take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--scene", default="exp2")
    parser.add_argument("--variant")
    parser.add_argument("--at", type=float, default=18.0, help="simulated time of the picture [s]")
    options = parser.parse_args()
    page_port, zenoh_port = free_port(), free_port()
    command = [sys.executable, "-m", "motm_twin.cli", "serve", options.scene]
    command += ["--port", str(page_port), "--zenoh-port", str(zenoh_port)]
    server = subprocess.Popen(command + (["--variant", options.variant] if options.variant else []))
    try:
        with TwinClient(f"tcp/127.0.0.1:{zenoh_port}") as client, sync_playwright() as playwright:
            while not page_answers(page_port):
                time.sleep(0.1)
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(f"http://127.0.0.1:{page_port}/")
            page.wait_for_selector("canvas")
            while (tick := client.tick()) is None or tick.time < options.at:
                time.sleep(0.02)
            for button in page.query_selector_all(".mantine-Notification-closeButton"):
                button.click()
            page.wait_for_timeout(1500)
            page.screenshot(path=str(options.path))
            browser.close()
    finally:
        server.terminate()
        server.wait(10.0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
