"""An object store in a folder, for tests: it reads, writes and removes objects for who has signed the request (AWS Signature Version 4 in the
query), with uploads in parts, which may be ranges of objects, conditions, and faults.

Written after "Authenticating Requests: Using Query Parameters", "Multipart upload", "UploadPartCopy" and "Conditional writes" in Amazon's
documentation of S3, with the standard library alone.

POST /faults?latency=SECONDS&busy=N&broken=N&refused=N&lost=N&plain=1 sets what goes wrong from now on: each answer comes so late; so many parts
are answered with 503, break off in the middle, are refused; so many objects are made without an answer; conditions are not known.
spared=N&denied=N: so many objects that come in one request are taken, then so many are refused; stuck=N: so many are not removed.
unlisted=1: of what is not there it is said that the keys may not look.
disputed=N: so often an object is not made, as something else is done to it at that moment; parts that it was to be made of are dropped.
uncopied=1&deaf=1&uniform=1&whole=1&changed=N: ranges are not copied, or taken for empty parts; all parts but the last must have one length; objects
are copied instead of their ranges; so many objects are changed right before they are copied.
GET /state tells what is under way, parts and uploads, and how many bytes came in parts and objects, went out, and were copied.
"""

import datetime
import hashlib
import hmac
import os
import re
import sys
import tempfile
import urllib.parse

import folder_store
from folder_store import Content, counts, digest, faults, happens, lock, serve

FOLDER, BUCKET, KEY_ID, SECRET, PUBLIC = sys.argv[1:6]
MARK = "x-amz-meta-fantex-upload"
# Beside the folder, so that what is made gets its name at once.
WORK = os.path.dirname(os.path.abspath(FOLDER))

uploads = {}
marks = {}
counts.update({"aborted": 0, "received": 0, "given": 0, "copied": 0})
MIN_PART = 5 << 20


def signature(method, path, query, headers, region, date, time):
    """The signature of a request, of whose headers all that count are given."""
    quote = lambda text: urllib.parse.quote(text, safe="-_.~")
    pairs = sorted((quote(name), quote(value)) for name, value in query if name != "X-Amz-Signature")
    lines = "".join(f"{name}:{' '.join(value.split())}\n" for name, value in headers)
    names = ";".join(name for name, _ in headers)
    canonical = "\n".join(
        [method, path, "&".join(f"{name}={value}" for name, value in pairs), lines, names, "UNSIGNED-PAYLOAD"]
    )
    scope = f"{date}/{region}/s3/aws4_request"
    text = "\n".join(["AWS4-HMAC-SHA256", time, scope, hashlib.sha256(canonical.encode()).hexdigest()])
    key = ("AWS4" + SECRET).encode()
    for part in (date, region, "s3", "aws4_request"):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()


class Handler(folder_store.Handler):
    def may_ask(self, path, query):
        values = dict(query)
        if "X-Amz-Signature" not in values:
            return False
        key_id, date, region, *rest = values["X-Amz-Credential"].split("/")
        time = values["X-Amz-Date"]
        age = datetime.datetime.now(datetime.timezone.utc) - datetime.datetime.strptime(time + "+0000", "%Y%m%dT%H%M%SZ%z")
        names = values["X-Amz-SignedHeaders"].split(";")
        sent = [name.lower() for name in self.headers if name.lower().startswith("x-amz-")]
        headers = [(name, self.headers.get(name, "")) for name in names]
        return (
            values["X-Amz-Algorithm"] == "AWS4-HMAC-SHA256"
            and (key_id, rest) == (KEY_ID, ["s3", "aws4_request"])
            and time.startswith(date)
            and -60 < age.total_seconds() < int(values["X-Amz-Expires"])
            and "host" in names
            and all(name in names for name in sent)
            and values["X-Amz-Signature"] == signature(self.command, path, query, headers, region, date, time)
        )

    def fail(self, status, code):
        self.answer(status, f"<?xml version=\"1.0\"?><Error><Code>{code}</Code><Message>no</Message></Error>".encode())

    def ask(self):
        """What the request is about: the object's file and the query; None where it is answered already."""
        if self.is_for_tests(len(uploads)):
            return None
        path, _, query = self.path.partition("?")
        bucket, _, self.key = urllib.parse.unquote(path)[1:].partition("/")
        pairs = urllib.parse.parse_qsl(query, keep_blank_values=True)
        is_public = self.command in ("GET", "HEAD") and self.key == PUBLIC
        if not is_public and not self.may_ask(path, pairs):
            # A connection on which something else is left to read cannot be used again.
            self.close_connection = True
            self.fail(403, "SignatureDoesNotMatch")
            return None
        if bucket != BUCKET:
            self.close_connection = True
            self.fail(404, "NoSuchBucket")
            return None
        return os.path.join(FOLDER, self.key)

    @staticmethod
    def tag(place):
        return '"%s"' % digest(place)

    def may_make(self, place):
        """Whether the request's condition holds; else it is answered. Called under the lock."""
        fresh, version = self.headers.get("If-None-Match"), self.headers.get("If-Match")
        if (fresh or version) and faults.get("plain"):
            self.fail(501, "NotImplemented")
            return False
        found = self.tag(place) if os.path.isfile(place) else None
        if (fresh and found) or (version and found != version):
            self.fail(412, "PreconditionFailed")
            return False
        return True

    def make(self, place, content, mark):
        os.makedirs(os.path.dirname(place), exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=WORK, delete=False) as file:
            file.write(content)
        os.replace(file.name, place)
        marks[self.key] = mark

    def do_GET(self):
        place = self.ask()
        if place is None:
            return
        if not os.path.isfile(place):
            return self.fail(403, "AccessDenied") if faults.get("unlisted") else self.fail(404, "NoSuchKey")
        content = Content(place)
        headers = [("ETag", self.tag(place))]
        if marks.get(self.key):
            headers.append((MARK, marks[self.key]))
        if self.command == "HEAD":
            return self.answer(200, content, headers)
        given = self.give_range(content, headers)
        if not given:
            return self.answer(416, headers=[*headers, ("Content-Range", f"bytes */{len(content)}")])
        with lock:
            counts["given"] += given

    def do_PUT(self):
        place = self.ask()
        if place is None:
            return
        part = self.query.get("partNumber")
        content = self.receive(is_part=part is not None, is_counted=True)
        if content is None:
            return
        with lock:
            counts["received"] += len(content)
        source = self.headers.get("x-amz-copy-source")
        if part and source and not faults.get("deaf"):
            return self.copy_part(int(part), urllib.parse.unquote(source))
        if part:
            if happens("busy"):
                return self.fail(503, "SlowDown")
            # Not the first, which others may follow.
            if int(part) > 1 and happens("refused"):
                return self.fail(400, "InvalidDigest")
            tag = self.take_part(int(part), content)
            return self.answer(200, headers=[("ETag", tag)]) if tag else None
        if happens("disputed"):
            return self.fail(409, "ConditionalRequestConflict")
        if not happens("spared") and happens("denied"):
            return self.fail(403, "ExpiredToken")
        with lock:
            if not self.may_make(place):
                return
            self.make(place, content, self.headers.get(MARK))
        self.made(place, 200)

    def take_part(self, number, content):
        """Keeps a part; gives its tag, none where it is answered already."""
        with lock:
            upload = uploads.get(self.query["uploadId"])
            if not upload or upload["key"] != self.key:
                return self.fail(404, "NoSuchUpload")
            upload["parts"][number] = content
            counts["parts"] += 1
        return '"%s"' % hashlib.md5(content).hexdigest()

    def copy_part(self, number, source):
        bucket, _, key = source.partition("/")
        place = os.path.join(FOLDER, key)
        if faults.get("uncopied"):
            return self.fail(501, "NotImplemented")
        if happens("busy"):
            return self.fail(503, "SlowDown")
        if bucket != BUCKET or not os.path.isfile(place):
            return self.fail(404, "NoSuchKey")
        if happens("changed"):
            with open(place, "ab") as file:
                file.write(b"x")
        version = self.headers.get("x-amz-copy-source-if-match")
        if version and version != self.tag(place):
            return self.fail(412, "PreconditionFailed")
        content = Content(place)
        first, last = map(int, re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers["x-amz-copy-source-range"]).groups())
        if not first <= last < len(content):
            return self.fail(400, "InvalidArgument")
        # Smaller objects are copied whole.
        if len(content) <= MIN_PART:
            return self.fail(400, "InvalidRequest")
        content = content[:] if faults.get("whole") else content[first : last + 1]
        tag = self.take_part(number, content)
        if not tag:
            return None
        with lock:
            counts["copied"] += len(content)
        escaped = tag.replace('"', "&quot;")
        result = f"<LastModified>2011-04-11T20:34:56.000Z</LastModified><ETag>{escaped}</ETag>"
        space = "http://s3.amazonaws.com/doc/2006-03-01/"
        self.answer(200, f'<?xml version="1.0"?><CopyPartResult xmlns="{space}">{result}</CopyPartResult>'.encode())

    def do_POST(self):
        place = self.ask()
        if place is None:
            return
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if "uploadId" in self.query and happens("disputed"):
            with lock:
                uploads.pop(self.query["uploadId"], None)
            return self.fail(409, "ConditionalRequestConflict")
        if "uploads" in self.query:
            name = hashlib.sha256(os.urandom(16)).hexdigest()
            with lock:
                uploads[name] = {"key": self.key, "parts": {}, "mark": self.headers.get(MARK)}
            begun = f"<Bucket>{BUCKET}</Bucket><UploadId>{name}</UploadId>"
            space = "http://s3.amazonaws.com/doc/2006-03-01/"
            text = f'<InitiateMultipartUploadResult xmlns="{space}">{begun}</InitiateMultipartUploadResult>'
            return self.answer(200, text.encode())
        with lock:
            upload = uploads.get(self.query["uploadId"])
            if not upload or upload["key"] != self.key:
                return self.fail(404, "NoSuchUpload")
            named = re.findall(r"<PartNumber>(\d+)</PartNumber><ETag>([^<]*)</ETag>", body.decode())
            parts = [upload["parts"].get(int(number), b"") for number, _ in named]
            tags = ['"%s"' % hashlib.md5(part).hexdigest() for part in parts]
            is_sound = [int(number) for number, _ in named] == list(range(1, len(upload["parts"]) + 1))
            if not is_sound or tags != [tag.replace("&quot;", '"') for _, tag in named]:
                return self.fail(400, "InvalidPart")
            if any(len(part) < MIN_PART for part in parts[:-1]):
                return self.fail(400, "EntityTooSmall")
            if faults.get("uniform") and len({len(part) for part in parts[:-1]}) > 1:
                return self.fail(400, "InvalidPart")
            if not self.may_make(place):
                return
            self.make(place, b"".join(parts), upload["mark"])
            del uploads[self.query["uploadId"]]
        self.made(place, 200, b"<CompleteMultipartUploadResult><ETag>a</ETag></CompleteMultipartUploadResult>")

    def do_DELETE(self):
        place = self.ask()
        if place is None:
            return
        if "uploadId" in self.query:
            with lock:
                uploads.pop(self.query["uploadId"], None)
                counts["aborted"] += 1
        elif happens("stuck"):
            return self.fail(403, "AccessDenied")
        elif os.path.isfile(place):
            os.remove(place)
        self.answer(204)

serve(Handler)
