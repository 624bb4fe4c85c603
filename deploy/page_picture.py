"""The README's picture of the page: a valve as a server shows it, from what the simulation gets wrong to the residual.

usage: page_picture.py CHROMIUM URL-OF-A-VALVE OUT.png      the address as the page's address bar holds it
"""
import base64
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests/browser"))
from chromium import Chromium  # noqa: E402

WIDTH = 1100


def main(chromium, url, out):
    with Chromium(chromium, width=WIDTH) as browser:
        browser.call("Emulation.setDeviceMetricsOverride", width=WIDTH, height=900, deviceScaleFactor=1, mobile=False)
        browser.call("Emulation.setScrollbarsHidden", hidden=True)  # as in the picture, so that it is measured as it is taken
        browser.open(url)
        browser.wait("document.querySelectorAll('.plots canvas').length >= 3")
        browser.wait("!document.querySelector('.plots').innerText.includes('Loading')")
        browser.wait("document.querySelector('.plots').innerText.includes('What the input does')")
        top, bottom = browser.run("""(() => {
          const found = [...document.querySelectorAll('h2')].find((head) => head.innerText.includes('gets wrong'));
          const charts = [...document.querySelectorAll('.chart')];
          return [found.getBoundingClientRect().top + scrollY, charts[1].getBoundingClientRect().bottom + scrollY];
        })()""")
        clip = {"x": 0, "y": top, "width": WIDTH, "height": bottom - top, "scale": 1}
        picture = browser.call("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        pathlib.Path(out).write_bytes(base64.b64decode(picture["data"]))


if __name__ == "__main__":
    main(*sys.argv[1:])
