"""The real server as a script meets it: started on a free loopback port with an empty database, ended with the block."""
import json
import pathlib
import subprocess
import tempfile
import urllib.error
import urllib.request


class RunningService:
    """`with RunningService(binary, *options) as service:`; `service.url`, `service.folder` for files of the test.
    `before(service)` runs when the folder is there and the server is not."""

    def __init__(self, binary, *options, before=lambda service: None, log=None):
        self.binary, self.options, self._before, self._log_to = str(binary), options, before, log

    def __enter__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="valvetriage-")
        self.folder = pathlib.Path(self._folder.name)
        self.data = self.folder / "data"
        self._before(self)
        self._log = open(self.folder / "server.log", "wb")
        self._server = subprocess.Popen(
            [self.binary, "serve", "--listen", "127.0.0.1:0", "--data-dir", self.data, *self.options],
            stdout=subprocess.PIPE, stderr=self._log_to or self._log, text=True)
        said = self._server.stdout.readline()
        if not said.startswith("listening on "):
            self._server.wait()
            raise RuntimeError((self.folder / "server.log").read_text())
        self.url = said.removeprefix("listening on ").strip()
        return self

    def stop(self):
        self._server.terminate()
        self._server.wait()

    def read_no_log(self):
        """Of a server that was started with log=subprocess.PIPE."""
        self._server.stderr.close()

    def __exit__(self, *_):
        self.stop()
        self._server.stdout.close()
        self._log.close()
        self._folder.cleanup()

    def run(self, *arguments, **options):
        """A verb of the product; its CompletedProcess with texts."""
        return subprocess.run([self.binary, *map(str, arguments)], capture_output=True, text=True, check=False, **options)

    def submit(self, *arguments):
        """`submit --wait --json` to this server: the exit status and the list of submissions."""
        done = self.run("submit", *arguments, "--server", self.url, "--wait", "--json")
        return done.returncode, json.loads(done.stdout)["submissions"]

    def request(self, path, body=None, method=None, headers=None):
        """Status and JSON of one request."""
        data = body.encode() if isinstance(body, str) else body
        asked = urllib.request.Request(self.url + path, data=data, method=method,
                                       headers={"Content-Type": "application/json", **(headers or {})})
        try:
            with urllib.request.urlopen(asked) as answer:
                return answer.status, json.loads(answer.read() or "null")
        except urllib.error.HTTPError as refused:
            with refused:
                return refused.code, json.loads(refused.read() or "null")

    def get(self, path):
        return self.request(path)[1]
