"""What the stores of the tests (`object_store.py`, `azure_store.py`) have in common: files of a folder that are read in ranges, faults that happen
so often, and counts. With the standard library alone."""

import hashlib
import http.server
import json
import os
import re
import threading
import time
import urllib.parse

lock = threading.RLock()
faults = {}
counts = {"parts": 0, "most_at_once": 0, "now": 0}


def happens(fault):
    """Whether a fault happens now; each does so often."""
    with lock:
        left = faults.get(fault, 0)
        faults[fault] = max(left - 1, 0)
        return left > 0


class Content:
    """The bytes of a file, of which only those are read that are asked for."""

    def __init__(self, place):
        self.file = open(place, "rb")
        self.length = os.fstat(self.file.fileno()).st_size

    def __len__(self):
        return self.length

    def __getitem__(self, span):
        first, last, _ = span.indices(self.length)
        self.file.seek(first)
        return self.file.read(max(last - first, 0))


digests = {}


def digest(place):
    """The MD5 of a file, which is read again only where it has changed."""
    found = os.stat(place)
    state = (found.st_ino, found.st_size, found.st_mtime_ns)
    known = digests.get(place)
    if known is None or known[0] != state:
        with open(place, "rb") as file:
            known = digests[place] = (state, hashlib.md5(file.read()).hexdigest())
    return known[1]


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def answer(self, status, body=b"", headers=(), is_late=True):
        time.sleep(faults.get("latency", 0) if is_late else 0)
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def is_for_tests(self, uploads):
        """Whether the request sets faults or asks for the state, in which so many uploads are under way; then it is answered. Keeps the query."""
        path, _, query = self.path.partition("?")
        self.query = dict(urllib.parse.parse_qsl(query, keep_blank_values=True))
        if path == "/faults":
            faults.update((name, float(value)) for name, value in self.query.items())
        elif path != "/state":
            return False
        self.answer(200, json.dumps({**counts, "uploads": uploads}).encode(), is_late=False)
        return True

    def give_range(self, content, headers):
        """Answers with the range that is asked for; gives its length, 0 where nothing lies there and the request is still to be answered."""
        first, last = map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers["Range"]).groups())
        if first >= len(content):
            return 0
        part = content[first : last + 1]
        span = f"bytes {first}-{first + len(part) - 1}/{len(content)}"
        self.answer(206, part, [*headers, ("Content-Range", span)])
        return len(part)

    def receive(self, is_part, is_counted):
        """The body of the request, which counts as under way or not; None where the connection breaks off in the middle of a part."""
        length = int(self.headers["Content-Length"])
        if is_part and happens("broken"):
            self.rfile.read(length // 2)
            self.close_connection = True
            return None
        with lock:
            counts["now"] += is_counted
            counts["most_at_once"] = max(counts["most_at_once"], counts["now"])
        content = self.rfile.read(length)
        time.sleep(faults.get("latency", 0))
        with lock:
            counts["now"] -= is_counted
        return content

    def made(self, place, status, body=b""):
        """Answers that a file was made, unless that answer is to be lost."""
        if happens("lost"):
            self.close_connection = True
            return
        self.answer(status, body, [("ETag", self.tag(place))])

    def do_HEAD(self):
        self.do_GET()

    def log_message(self, *_):
        pass


def serve(handler):
    """Prints the port and answers requests."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    print(server.server_address[1], flush=True)
    server.serve_forever()
