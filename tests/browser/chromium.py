"""A real Chromium without a window, spoken to by the DevTools protocol over a pipe: nothing but Python and Chromium."""
import base64
import json
import os
import select
import subprocess
import tempfile
import time

PATIENCE_S = float(os.environ.get("VALVETRIAGE_BROWSER_PATIENCE_S", 120))  # only a hang gets there

READ = "(document.body?.innerText ?? '').replaceAll('\\u00a0', ' ')"


class Chromium:
    """`with Chromium(binary) as browser:`; one page. Every question to the page is polled until it holds."""

    def __init__(self, binary, width=1280, height=900, dark=False):
        self._binary, self._size, self._dark = binary, (width, height), dark
        self._number, self._buffer = 0, b""
        self.errors = []  # what the page's console said that was no good news

    def __enter__(self):
        self._profile = tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True)
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()
        os.set_inheritable(to_read, True)
        os.set_inheritable(to_write, True)

        def as_three_and_four():
            first, second = os.dup(to_read), os.dup(to_write)
            os.dup2(first, 3)
            os.dup2(second, 4)

        self._process = subprocess.Popen(
            [self._binary, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
             "--remote-debugging-pipe", "--disable-background-networking", "--disable-component-update",
             f"--window-size={self._size[0]},{self._size[1]}", f"--user-data-dir={self._profile.name}", "about:blank"],
            close_fds=False, preexec_fn=as_three_and_four, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_read)
        os.close(to_write)
        self._session = None
        pages = self.call("Target.getTargets")["targetInfos"]
        target = next(page["targetId"] for page in pages if page["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(domain + ".enable")
        self.call("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-color-scheme", "value": "dark" if self._dark else "light"}])
        return self

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait()
        os.close(self._read)
        os.close(self._write)
        self._profile.cleanup()

    def _message(self):
        while b"\0" not in self._buffer:
            if not select.select([self._read], [], [], PATIENCE_S)[0]:
                raise TimeoutError("Chromium says nothing")
            piece = os.read(self._read, 1 << 20)
            if not piece:
                raise RuntimeError("Chromium ended")
            self._buffer += piece
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)

    def call(self, method, **parameters):
        self._number += 1
        asked = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            asked["sessionId"] = self._session
        os.write(self._write, json.dumps(asked).encode() + b"\0")
        while True:
            said = self._message()
            if said.get("id") == self._number:
                if "error" in said:
                    raise RuntimeError(f"{method}: {said['error']}")
                return said["result"]
            self._note(said)

    def _note(self, said):
        method, parameters = said.get("method"), said.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(parameters["exceptionDetails"].get("exception", {}).get("description", "exception"))
        if method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(f"{parameters['entry']['text']} {parameters['entry'].get('url', '')}")

    def open(self, url):
        self.call("Page.navigate", url=url)

    def run(self, script):
        """The value of an expression in the page; a promise is waited for."""
        said = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in said:
            raise RuntimeError(said["exceptionDetails"].get("exception", {}).get("description", script))
        return said["result"].get("value")

    def wait(self, script):
        """Until the expression is true; its value."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            value = self.run(script)
            if value:
                return value
            if time.monotonic() > deadline:
                raise TimeoutError(f"never true: {script}; the page says: {self.text()[:2000]}")
            time.sleep(0.05)

    def text(self):
        """As a person reads it: a space that keeps a line together is a space."""
        return self.run(READ)

    def wait_for_text(self, text):
        return self.wait(f"({READ}).includes({json.dumps(text)})")

    def screenshot(self, file, whole=True):
        height = self.run("document.documentElement.scrollHeight") if whole else self._size[1]
        clip = {"x": 0, "y": 0, "width": self._size[0], "height": height, "scale": 1}
        picture = self.call("Page.captureScreenshot", captureBeyondViewport=whole, clip=clip)
        with open(file, "wb") as out:
            out.write(base64.b64decode(picture["data"]))

    def save_to(self, folder):
        """Downloads go there from now on."""
        session, self._session = self._session, None
        self.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
        self._session = session

    def drop_files(self, selector, files):
        """Drops files or folders onto an element."""
        x, y = self.run(f"(() => {{ const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); return [r.x + r.width / 2, r.y + 20]; }})()")
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def set_files(self, selector, files):
        """Chooses files in an <input type=file>."""
        document = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=document, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", nodeId=node, files=[str(file) for file in files])
