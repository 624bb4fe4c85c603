"""Lines of JSON that are kept in a file by key, so that a long run can be ended anywhere and taken up again."""
import json


class Kept:
    """One process writes; a line that was cut short is left out when the file is read."""

    def __init__(self, path):
        self.path = path
        self.lines = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            for text in path.read_text().split("\n"):
                try:
                    line = json.loads(text)
                except ValueError:
                    continue
                self.lines[line["key"]] = line

    def __contains__(self, key):
        return key in self.lines

    def __getitem__(self, key):
        return self.lines[key]

    def get(self, key):
        """None where there is no such line."""
        return self.lines.get(key)

    def add(self, line):
        """`line` has its key in it."""
        self.lines[line["key"]] = line
        with open(self.path, "a") as file:
            file.write("\n" + json.dumps(line))  # begins a line of its own, whatever the last run left
