"""An object store in a folder, for tests: reads of ranges by who has signed them (AWS Signature Version 4 in the query).

Written after "Authenticating Requests: Using Query Parameters" in Amazon's S3 API reference, with the standard library alone.
"""

import datetime
import hashlib
import hmac
import http.server
import os
import re
import sys
import urllib.parse

FOLDER, BUCKET, KEY_ID, SECRET, PUBLIC = sys.argv[1:6]


def signature(host, path, query, region, date, time):
    """The signature of a GET request."""
    quote = lambda text: urllib.parse.quote(text, safe="-_.~")
    pairs = sorted((quote(name), quote(value)) for name, value in query if name != "X-Amz-Signature")
    canonical = "\n".join(
        ["GET", path, "&".join(f"{name}={value}" for name, value in pairs), f"host:{host}\n", "host", "UNSIGNED-PAYLOAD"]
    )
    scope = f"{date}/{region}/s3/aws4_request"
    text = "\n".join(["AWS4-HMAC-SHA256", time, scope, hashlib.sha256(canonical.encode()).hexdigest()])
    key = ("AWS4" + SECRET).encode()
    for part in (date, region, "s3", "aws4_request"):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def may_read(self, path, query):
        values = dict(query)
        if "X-Amz-Signature" not in values:
            return False
        key_id, date, region, *rest = values["X-Amz-Credential"].split("/")
        time = values["X-Amz-Date"]
        age = datetime.datetime.now(datetime.timezone.utc) - datetime.datetime.strptime(time + "+0000", "%Y%m%dT%H%M%SZ%z")
        return (
            values["X-Amz-Algorithm"] == "AWS4-HMAC-SHA256"
            and (key_id, rest) == (KEY_ID, ["s3", "aws4_request"])
            and time.startswith(date)
            and -60 < age.total_seconds() < int(values["X-Amz-Expires"])
            and values["X-Amz-Signature"] == signature(self.headers["Host"], path, query, region, date, time)
        )

    def answer(self, status, body=b"", headers=()):
        self.send_response(status)
        for name, value in headers:
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self):
        path, _, query = self.path.partition("?")
        query = urllib.parse.parse_qsl(query, keep_blank_values=True)
        bucket, _, key = urllib.parse.unquote(path)[1:].partition("/")
        if key != PUBLIC and not self.may_read(path, query):
            return self.answer(403)
        place = os.path.join(FOLDER, key)
        if bucket != BUCKET or not os.path.isfile(place):
            return self.answer(404)
        with open(place, "rb") as file:
            content = file.read()
        first, last = map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers["Range"]).groups())
        etag = ("ETag", '"%s"' % hashlib.md5(content).hexdigest())
        if first >= len(content):
            return self.answer(416, headers=[etag, ("Content-Range", f"bytes */{len(content)}")])
        part = content[first : last + 1]
        place = f"bytes {first}-{first + len(part) - 1}/{len(content)}"
        self.answer(206, part, [etag, ("Content-Range", place)])

    def log_message(self, *_):
        pass


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
print(server.server_address[1], flush=True)
server.serve_forever()
