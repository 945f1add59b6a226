"""Bakes on a cluster of Dask: one plan, parts as tasks, one merge (``pip install fantex[distributed]``)."""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
import time
import uuid
import warnings
from typing import Any, Dict, List, Optional, Tuple, Union

from . import _native
from ._asset import Asset
from ._bake import Function, Source
from ._given import PATHS, Path, absolute, failed, is_address
from ._mesh import Mesh, Progress
from ._plan import Plan, bake_part, merge, plan

__all__ = ["bake"]

# Parts per worker where nobody says how many: a lost worker costs a quarter of its work.
_PARTS_PER_WORKER = 4

# What a second attempt would not change.
_LASTING = (_native.Error, FileNotFoundError, TypeError, ValueError)


def bake(
    client: Any,
    model: Any,
    out: Path,
    *,
    source: Union[Source, Function, None] = None,
    shards: Optional[int] = None,
    retries: int = 3,
    folder: Optional[Path] = None,
    overwrite: bool = False,
    memory: float = 1 << 30,
    progress: Optional[Progress] = None,
    **settings: Any,
) -> Asset:
    """Bakes on the workers of a Dask client. The file is byte for byte what :func:`fantex.bake` writes.

    The calling process plans and merges, so it needs the memory for the mesh and its tiles, and no texels. Parts lie in a folder that
    all workers and the caller see under one path, or in an object store; the model and the pictures that it refers to are read from paths.

    Args:
        client: a ``distributed.Client``, of whatever cluster.
        model: a path, or what is sent to the workers: ``(positions, faces)``, a mesh of trimesh.
        out: the asset to write, ``.fan``, also at an ``s3://``, ``gs://`` or ``az://`` address. It appears at the end, whole, or not at all.
        source: as for :func:`fantex.bake`; a function is sent to the workers.
        shards: number of parts; four per worker by default.
        retries: how often a part is tried again after an error of a worker's disk, an exception of a function, or a damaged part. What
            cannot get better (wrong arguments, unreadable models) is raised at once. Dask itself moves parts of lost workers to others.
        folder: where the folder of parts is made: a shared one, or an address in a store, for which all workers have the keys; beside
            ``out`` by default. The parts are removed at the end.
        overwrite: replace an existing file.
        memory: bytes that texels in flight, images and photographs of one part may take.
        progress: called with ``(done, total)`` texels, whenever a part is done; what it raises ends the bake.
        settings: ``texels``, ``density``, ``match``, ``tile``, ``longest_edge``, ``hard_edges``, ``alpha``, ``weld``, ``format``, ``fit``,
            ``quality`` and ``seed`` of :func:`fantex.bake`.

    Raises:
        ImportError: ``distributed`` is not installed.
        TypeError: what cannot be sent to workers.
        Error: a part failed; the sentence says which, and why.
        What :func:`fantex.bake` raises: as there. Exceptions of a function arrive as they were raised.
        KeyboardInterrupt: Ctrl-C; workers end their parts, and nothing is left.
    """
    workers = _workers(client)
    model = model._path if isinstance(model, Asset) else model
    out = absolute(out)
    if os.path.lexists(out) and not overwrite:
        raise FileExistsError(f"{out} exists; overwrite=True replaces it")
    _native.check_target(out, overwrite)
    if shards is not None and shards < 1:
        raise ValueError(f"shards is {shards}; at least one part is needed")
    if retries < 0:
        raise ValueError(f"retries is {retries}; it cannot be negative")
    if isinstance(model, Mesh):
        raise TypeError("a fantex.Mesh cannot be sent to workers; give the path or the arrays that it was made of")
    parent = os.path.dirname(out) if folder is None else absolute(folder).rstrip("/")
    prefix = f".{os.path.basename(out)}.parts-"
    if is_address(parent):
        scratch = _join(parent, prefix + uuid.uuid4().hex)
    else:
        scratch = tempfile.mkdtemp(prefix=prefix, dir=parent)
    count = 0
    try:
        planned = plan(model, _join(scratch, "plan"), source=source, memory=memory, **settings)
        count = min(shards or _PARTS_PER_WORKER * workers, max(planned.tiles, 1))
        run = _Run(client, planned, count, retries, model, source, memory, progress)
        run.finish(range(1, count + 1))
        return run.merge(out, overwrite)
    finally:
        _remove(scratch, count)


def _remove(folder: str, parts: int) -> None:
    """Removes the plan and its parts. In a folder, parts of a bake that was given up may still begin files; in a store, workers remove
    what they have sent in vain."""
    if is_address(folder):
        for name in ["plan", *(f"{number}.part" for number in range(1, parts + 1))]:
            try:
                _native.remove_object(_join(folder, name))
            except (OSError, _native.Error) as error:
                warnings.warn(f"what is left of the bake was not removed: {error}", stacklevel=3)
                return
        return
    for _ in range(100):
        shutil.rmtree(folder, ignore_errors=True)
        if not os.path.lexists(folder):
            return
        time.sleep(0.1)


def _join(folder: str, name: str) -> str:
    return f"{folder}/{name}" if is_address(folder) else os.path.join(folder, name)


def _is_there(place: str) -> bool:
    """Whether there is a file or an object."""
    return _native.is_there(place) if is_address(place) else os.path.isfile(place)


class _Run:
    """A planned bake on its way: which parts are done, and how often one may be tried again."""

    def __init__(
        self,
        client: Any,
        planned: Plan,
        count: int,
        retries: int,
        model: Any,
        source: Union[Source, Function, None],
        memory: float,
        progress: Optional[Progress],
    ) -> None:
        self.client, self.plan, self.count, self.retries = client, planned, count, retries
        self.memory, self.progress = memory, progress
        is_file = isinstance(model, PATHS)
        # A mesh in memory is sent once per worker, not with each part.
        self.model = None if is_file else client.scatter([model], broadcast=True, hash=False)[0]
        self.source = source

    def part(self, number: int) -> str:
        return _join(os.path.dirname(self.plan.path), f"{number}.part")

    def finish(self, numbers: Any) -> None:
        """Bakes parts, and returns when all are there."""
        from distributed import KilledWorker, as_completed

        futures: Dict[Any, int] = {
            self.client.submit(
                _part,
                self.plan.path,
                (number, self.count),
                self.part(number),
                self.model,
                self.source,
                self.memory,
                pure=False,
                retries=self.retries,
                key=f"fantex-part-{os.path.basename(os.path.dirname(self.plan.path))}-{number}-{time.monotonic_ns()}",
            ): number
            for number in numbers
        }
        done = self.count - len(futures)
        try:
            for future in as_completed(list(futures)):
                number = futures[future]
                try:
                    lasting = future.result()
                except KilledWorker as error:
                    raise failed(
                        f"part {number} of {self.count} ended each worker that it ran on; "
                        "they may lack memory (give more parts or less memory=)"
                    ) from error
                if lasting is not None:
                    raise lasting
                done += 1
                if self.progress is not None:
                    texels = self.plan.texels
                    _native.tell(self.progress, texels * done // self.count, texels, "baking")
        finally:
            self.client.cancel(list(futures), force=True)

    def merge(self, out: str, overwrite: bool) -> Asset:
        """Merges, and bakes parts anew that are missing or damaged."""
        parts: List[str] = [self.part(number) for number in range(1, self.count + 1)]
        for attempt in range(self.retries + 1):
            bad = [number for number, part in enumerate(parts, 1) if not _is_there(part)]
            if not bad:
                try:
                    return merge(self.plan, parts, out, overwrite=overwrite)
                except _native.Error as error:
                    bad = [number for number, part in enumerate(parts, 1) if str(error.path) == part]
                    if not bad or attempt == self.retries:
                        raise
            if attempt < self.retries:
                self.finish(bad)
        raise failed(
            f"{parts[bad[0] - 1]} was baked and is not there; workers and caller need a folder that all of them see (folder=)"
        )


def _part(
    plan_path: str,
    shard: Tuple[int, int],
    path: str,
    model: Any,
    source: Union[Source, Function, None],
    memory: float,
) -> Optional[BaseException]:
    """The task of a worker. Returns what a second attempt would not change; raises what Dask shall try again."""
    if not _is_there(plan_path):
        return failed(
            f"a worker does not see {plan_path}; workers and caller need a folder that all of them see (folder=)"
        )
    looked, pause = time.monotonic(), 10 if is_address(plan_path) else 1
    raised: List[BaseException] = []
    if source is not None and not isinstance(source, Source):
        source = _listening(source, raised)

    def is_wanted(done: int, total: int) -> None:
        # The caller removes the plan when it gives up; tasks that run already end here.
        nonlocal looked
        if time.monotonic() - looked > pause:
            looked = time.monotonic()
            if not _is_there(plan_path):
                raise failed("the bake was given up")

    try:
        bake_part(
            plan_path, shard, path, mesh=model, source=source, overwrite=True, memory=memory, progress=is_wanted
        )
        if is_address(path) and not _is_there(plan_path):
            # Nobody else would remove it.
            _native.remove_object(path)
    except _LASTING as error:
        # A function may fare better the next time, whatever it raises.
        if any(error is own for own in raised):
            raise
        return error
    except (Exception, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        # A panic of the compiled part is no Exception, and would end the worker's thread without an answer.
        return failed(f"part {shard[0]} of {shard[1]} failed inside: {error}")
    return None


def _listening(function: Function, raised: List[BaseException]) -> Function:
    """The function, with a list of what it raises."""

    @functools.wraps(function)
    def listening(*given: Any, **named: Any) -> Any:
        try:
            return function(*given, **named)
        except Exception as error:
            raised.append(error)
            raise

    return listening


def _workers(client: Any) -> int:
    """How many workers a client has; waits for the first."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("fantex.distributed needs Dask: pip install 'fantex[distributed]'") from error
    if not isinstance(client, Client):
        raise TypeError(f"client is a {type(client).__name__}; expected a distributed.Client")
    if client.asynchronous:
        raise TypeError("client is asynchronous; fantex.distributed.bake needs one that waits")
    client.wait_for_workers(1)
    return len(client.scheduler_info(n_workers=-1)["workers"])
