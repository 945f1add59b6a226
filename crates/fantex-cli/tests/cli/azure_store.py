"""Azure's Blob Storage in a folder, for tests: it reads, writes and removes blobs for who has signed the request (Shared Key) or has a token in
its query, with blocks, conditions, and faults.

Written after "Authorize with Shared Key", "Put Blob", "Put Block", "Put Block List" and "Specifying conditional headers for Blob service
operations" in Microsoft's documentation, with the standard library alone.

POST /faults?latency=SECONDS&busy=N&broken=N&refused=N&lost=N&raced=N&overtaken=N&leased=1 sets what goes wrong from now on: each answer comes so
late; so many blocks are answered with 503, break off in the middle, are refused; so many blobs are made without an answer, are there before they
are made, have lost their blocks by the end of another upload; blobs that are there are leased.
GET /state tells what is under way: blocks, and blobs that have some that belong to nothing.
"""

import base64
import binascii
import datetime
import email.utils
import hashlib
import hmac
import os
import re
import sys
import urllib.parse
import xml.etree.ElementTree

import folder_store
from folder_store import Content, counts, digest, faults, happens, lock, serve

FOLDER, CONTAINER, ACCOUNT, KEY, TOKEN, PUBLIC = sys.argv[1:7]
SIGNED_HEADERS = (
    "Content-Encoding",
    "Content-Language",
    "Content-Length",
    "Content-MD5",
    "Content-Type",
    "Date",
    "If-Modified-Since",
    "If-Match",
    "If-None-Match",
    "If-Unmodified-Since",
    "Range",
)

uncommitted = {}
committed = {}
metadata = {}


def signature(method, path, query, headers):
    """The signature of a request: path as it came, query decoded."""
    values = [headers.get(name, "") for name in SIGNED_HEADERS]
    if values[2] == "0":
        values[2] = ""
    own = sorted((name.lower(), " ".join(value.split())) for name, value in headers.items() if name.lower().startswith("x-ms-"))
    named = {}
    for name, value in query:
        named.setdefault(name.lower(), []).append(value)
    text = "\n".join([method, *values]) + "\n"
    text += "".join(f"{name}:{value}\n" for name, value in own)
    text += f"/{ACCOUNT}{path}"
    text += "".join(f"\n{name}:{','.join(sorted(named[name]))}" for name in sorted(named))
    return base64.b64encode(hmac.new(base64.b64decode(KEY), text.encode(), hashlib.sha256).digest()).decode()


class Handler(folder_store.Handler):
    def may_ask(self, path, query):
        """None, or with which status and code the request is refused."""
        proof = self.headers.get("Authorization")
        raw = query.split("&") if query else []
        if proof is None and any(part.startswith("sig=") for part in raw):
            given = [part for part in raw if part in TOKEN.split("&")]
            return None if "&".join(given) == TOKEN else (403, "AuthenticationFailed")
        if proof is None:
            return (409, "PublicAccessNotPermitted") if self.command in ("GET", "HEAD") else (401, "NoAuthenticationInformation")
        if not re.fullmatch(r"20\d\d-\d\d-\d\d", self.headers.get("x-ms-version", "")):
            return (400, "MissingRequiredHeader")
        date = email.utils.parsedate_to_datetime(self.headers["x-ms-date"])
        age = datetime.datetime.now(datetime.timezone.utc) - date
        expected = f"SharedKey {ACCOUNT}:" + signature(self.command, path, urllib.parse.parse_qsl(query), self.headers)
        is_right = abs(age.total_seconds()) < 900 and hmac.compare_digest(proof, expected)
        return None if is_right else (403, "AuthenticationFailed")

    def fail(self, status, code, headers=()):
        body = f'\ufeff<?xml version="1.0" encoding="utf-8"?><Error><Code>{code}</Code><Message>no</Message></Error>'
        self.answer(status, body.encode(), [*headers, ("x-ms-error-code", code)])

    def ask(self):
        """What the request is about: the blob's file and the query; None where it is answered already."""
        if self.is_for_tests(len(uncommitted)):
            return None
        path, _, query = self.path.partition("?")
        account, container, self.key = (urllib.parse.unquote(path)[1:].split("/", 2) + ["", ""])[:3]
        is_public = self.command in ("GET", "HEAD") and self.key == PUBLIC
        refusal = None if is_public else self.may_ask(path, query)
        if account != ACCOUNT or not self.key:
            refusal = (400, "InvalidUri")
        elif refusal is None and container != CONTAINER:
            refusal = (404, "ContainerNotFound")
        if refusal is not None:
            # A connection on which something else is left to read cannot be used again.
            self.close_connection = True
            self.fail(*refusal)
            return None
        return os.path.join(FOLDER, self.key)

    @staticmethod
    def tag(place):
        return '"0x8D%s"' % digest(place)[:13].upper()

    def may_make(self, place):
        """Whether the request's condition holds; else it is answered. Called under the lock."""
        if happens("raced"):
            with open(place, "wb") as file:
                file.write(b"first")
        found = self.tag(place) if os.path.isfile(place) else None
        if found and faults.get("leased"):
            self.fail(412, "LeaseIdMissing")
            return False
        if self.headers.get("If-None-Match") == "*" and found:
            self.fail(409, "BlobAlreadyExists")
            return False
        version = self.headers.get("If-Match")
        if version and found != version:
            self.fail(412, "ConditionNotMet")
            return False
        return True

    def make(self, place, content, blocks):
        """Called under the lock. Blocks that are not in it are dropped."""
        with open(place, "wb") as file:
            file.write(content)
        uncommitted.pop(self.key, None)
        committed[self.key] = blocks
        metadata[self.key] = [(name, value) for name, value in self.headers.items() if name.lower().startswith("x-ms-meta-")]

    def do_GET(self):
        place = self.ask()
        if place is None:
            return
        if not os.path.isfile(place):
            return self.fail(404, "BlobNotFound")
        content = Content(place)
        headers = [("ETag", self.tag(place)), *metadata.get(self.key, [])]
        if self.command == "HEAD":
            return self.answer(200, b"", headers)
        if self.headers.get("If-Range"):
            return self.fail(400, "UnsupportedHeader")
        if not self.give_range(content, headers):
            self.fail(416, "InvalidRange", [("Content-Range", f"bytes */{len(content)}")])

    def do_PUT(self):
        place = self.ask()
        if place is None:
            return
        os.makedirs(os.path.dirname(place), exist_ok=True)
        what = self.query.get("comp")
        if self.headers.get("Transfer-Encoding") or "Content-Length" not in self.headers:
            self.close_connection = True
            return self.fail(411, "MissingContentLengthHeader")
        # A block of one byte asks whether one may write.
        is_part = what == "block" and int(self.headers["Content-Length"]) > 1
        content = self.receive(is_part, is_counted=is_part)
        if content is None:
            return
        if what == "block":
            return self.put_block(content)
        names = [name.lower()[len("x-ms-meta-") :] for name in self.headers if name.lower().startswith("x-ms-meta-")]
        if not all(re.fullmatch(r"[A-Za-z_]\w*", name) for name in names):
            return self.fail(400, "InvalidMetadata")
        if what == "blocklist":
            return self.put_block_list(place, content)
        if self.headers.get("x-ms-blob-type") != "BlockBlob" or self.query.keys() & {"comp", "blockid"}:
            return self.fail(400, "MissingRequiredHeader")
        with lock:
            if not self.may_make(place):
                return
            self.make(place, content, {})
        self.made(place, 201)

    def put_block(self, content):
        name = self.query.get("blockid", "")
        try:
            is_name = 0 < len(base64.b64decode(name, validate=True)) <= 64
        except binascii.Error:
            is_name = False
        if not is_name or not content:
            return self.fail(400, "InvalidQueryParameterValue")
        if len(content) > 1 and happens("busy"):
            return self.fail(503, "ServerBusy")
        with lock:
            blocks = uncommitted.setdefault(self.key, {})
            if any(len(other) != len(name) for other in blocks):
                return self.fail(400, "InvalidBlobOrBlock")
        # Not the first, which others may follow.
        if len(blocks) > 1 and happens("refused"):
            return self.fail(400, "Md5Mismatch")
        with lock:
            uncommitted.setdefault(self.key, {})[name] = content
            counts["parts"] += len(content) > 1
        self.answer(201)

    def put_block_list(self, place, body):
        if happens("overtaken"):
            with lock:
                uncommitted.pop(self.key, None)
        named = [(entry.tag, entry.text) for entry in xml.etree.ElementTree.fromstring(body)]
        with lock:
            fresh, old = uncommitted.get(self.key, {}), committed.get(self.key, {})
            blocks = {}
            for kind, name in named:
                sources = {"Uncommitted": [fresh], "Committed": [old], "Latest": [fresh, old]}[kind]
                found = next((source[name] for source in sources if name in source), None)
                if found is None:
                    return self.fail(400, "InvalidBlockList")
                blocks[name] = found
            if not self.may_make(place):
                return
            self.make(place, b"".join(blocks[name] for _, name in named), blocks)
        self.made(place, 201)

    def do_POST(self):
        if self.ask() is not None:
            self.fail(405, "UnsupportedHttpVerb")

    def do_DELETE(self):
        place = self.ask()
        if place is None:
            return
        if not os.path.isfile(place):
            return self.fail(404, "BlobNotFound")
        os.remove(place)
        self.answer(202)

serve(Handler)
