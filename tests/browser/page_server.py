"""The server that the tests of the page talk to, and the recordings they send it."""
import json
import math
import struct
import subprocess
import time
import urllib.request
import zlib

HOSTILE = '<img src=x onerror="window.hacked=1">'


def recording(serial, lot, bad_line=None, stuck=False, **labels):
    """Steps at 200 Hz with a first-order response; stuck: the gauge stands still from 1.5 to 1.6 s."""
    more = [f"# {name}: {value}" for name, value in labels.items()]
    lines = [f"# serial: {serial}", f"# lot: {lot}", "# test: step", *more, "time_s,current_A,pressure_psi"]
    pressure = 26.0
    for i in range(400):
        current = 1.2 if i < 100 else 1.6 if i < 250 else 1.4
        pressure += 0.08 * (26 + 150 * (current - 1.2) - pressure)
        shown = shown if stuck and 300 < i < 320 else pressure + 0.05 * math.sin(i * i)
        lines.append(f"{0.005 * i:.4f},{current:.4f},{shown:.3f}")
    if bad_line is not None:
        lines[bad_line - 1] = "0.1,1.2,n/a"
    return "\n".join(lines) + "\n"


def zstd_frame(content):
    """A zstd frame (RFC 8878) of raw blocks: packed without a packer."""
    frame = b"\x28\xb5\x2f\xfd" + b"\xa0" + len(content).to_bytes(4, "little")  # one segment, its size in 4 bytes
    most = 100_000
    for begin in range(0, len(content), most):
        block = content[begin:begin + most]
        last = begin + most >= len(content)
        frame += (len(block) << 3 | last).to_bytes(3, "little") + block
    return frame


def mat_file(csv, packed=False, **labels):
    """The numbers of a CSV recording as a MAT v5 file with these texts; packed: each variable by zlib, as MATLAB saves."""
    def element(kind, data):
        if len(data) <= 4:
            return struct.pack("<HH", kind, len(data)) + data.ljust(4, b"\0")
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    def variable(name, kind, count, data_kind, data):
        flags = element(6, struct.pack("<II", kind, 0))
        matrix = element(14, flags + element(5, struct.pack("<ii", 1, count)) + element(1, name.encode()) + element(data_kind, data))
        if not packed:
            return matrix
        pressed = zlib.compress(matrix)
        return struct.pack("<II", 15, len(pressed)) + pressed

    lines = [line.split(",") for line in csv.splitlines() if not line.startswith("#")]
    columns = {name: [float(line[i]) for line in lines[1:]] for i, name in enumerate(lines[0])}
    file = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    for name, values in columns.items():
        file += variable(name, 6, len(values), 9, struct.pack(f"<{len(values)}d", *values))
    for name, text in labels.items():
        file += variable(name, 4, len(text), 4, text.encode("utf-16-le"))
    return file


class Server:
    def __init__(self, binary, folder):
        self._command, self._port = [binary, "serve", folder], 0
        self.start()

    def start(self):
        """On a port of the system's choice; after kill() on the same one again."""
        self._process = subprocess.Popen([*self._command, str(self._port)], stdout=subprocess.PIPE, text=True)
        self._port = int(self._process.stdout.readline())
        self.url = f"http://127.0.0.1:{self._port}"

    def pid(self):
        return self._process.pid

    def kill(self):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()

    def end(self):
        self._process.terminate()
        self._process.wait()
        self._process.stdout.close()

    def send(self, csv):
        """Uploads a recording; the submission once its job has ended."""
        row = self.post("/v1/recordings?name=steps.csv", csv)
        while row["state"] in ("queued", "running"):
            time.sleep(0.02)
            row = self.get(f"/v1/recordings/{row['id']}")
        return row

    def post(self, path, document):
        """A document, or the text of a CSV recording."""
        data, kind = (document, "text/csv") if isinstance(document, str) else (json.dumps(document), "application/json")
        asked = urllib.request.Request(self.url + path, data=data.encode(), method="POST", headers={"Content-Type": kind})
        with urllib.request.urlopen(asked) as answer:
            return json.loads(answer.read())

    def get(self, path):
        with urllib.request.urlopen(self.url + path) as answer:
            return json.loads(answer.read())
