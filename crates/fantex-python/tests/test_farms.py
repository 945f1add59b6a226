"""The files for schedulers in docs/farms run as they stand, on a small model and with fewer texels."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fantex
from conftest import ROOT

FARMS = ROOT / "docs" / "farms"
TEXELS = 60_000


@pytest.fixture(scope="module")
def program():
    """The command line's program; FANTEX_PROGRAM names it."""
    known = [os.environ.get("FANTEX_PROGRAM"), ROOT / "target" / "debug" / "fantex", shutil.which("fantex")]
    for path in known:
        if path and Path(path).is_file():
            return Path(path)
    pytest.skip("no program fantex (set FANTEX_PROGRAM)")


@pytest.fixture
def world(tmp_path, program, sphere, monkeypatch):
    """A folder with world.glb, and the bake that farms are to repeat."""
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    fantex.bake(sphere, tmp_path / "start.fan", texels=20_000, source=fantex.solid("marble")).export(
        tmp_path / "world.glb", resolution=256
    )
    (tmp_path / "start.fan").unlink()
    run(tmp_path, "fantex", "bake", "world.glb", "-o", "whole.fan", "--texels", str(TEXELS))
    return tmp_path


def run(folder, *command, **variables):
    """Runs a command; its output stands in the message when it fails."""
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, **variables}, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def same(world):
    assert (world / "world.fan").read_bytes() == (world / "whole.fan").read_bytes()


def plan(world):
    run(world, "fantex", "plan", "world.glb", "-o", "world.plan", "--texels", str(TEXELS))


def fewer(name, *replacements):
    """A file's text, with what makes it small; each must be found."""
    text = (FARMS / name).read_text(encoding="utf-8")
    for old, new in replacements:
        assert old in text, f"{name} has no {old}"
        text = text.replace(old, new)
    return text


@pytest.mark.skipif(os.name == "nt", reason="no shell")
def test_slurm(world):
    (world / "slurm.sh").write_text(fewer("slurm.sh", ("=1-64", "=1-3"), ("shards=64", "shards=3")), encoding="utf-8")
    plan(world)
    for task in (2, 3, 1):
        run(world, "sh", "slurm.sh", SLURM_ARRAY_TASK_ID=str(task), SLURM_CPUS_PER_TASK="1")
    # A part that was lost is submitted again.
    run(world, "sh", "slurm.sh", SLURM_ARRAY_TASK_ID="2", SLURM_CPUS_PER_TASK="1")
    run(world, "sh", "-c", "fantex merge world.plan *.part -o world.fan")
    same(world)


@pytest.mark.skipif(os.name == "nt", reason="no shell")
def test_kubernetes(world):
    yaml = pytest.importorskip("yaml", reason="no PyYAML for Python")
    text = fewer("kubernetes.yaml", ("64", "3"), ("parallelism: 16", "parallelism: 1"))
    spec = yaml.safe_load(text)["spec"]
    (container,) = spec["template"]["spec"]["containers"]
    variables = {entry["name"]: entry["value"] for entry in container["env"]}
    assert spec["completionMode"] == "Indexed" and str(spec["completions"]) == variables["SHARDS"]
    assert len(container["args"]) == 1
    plan(world)
    for index in range(spec["completions"]):
        command = container["args"][0].replace("/world/", f"{world}/")
        run(world, *container["command"], command, JOB_COMPLETION_INDEX=str(index), **variables)
    run(world, "sh", "-c", "fantex merge world.plan *.part -o world.fan")
    same(world)


def test_snakemake(world):
    pytest.importorskip("snakemake", reason="no snakemake for Python")
    text = fewer("Snakefile", ("SHARDS = 64", "SHARDS = 3"), ("16G", str(TEXELS)))
    (world / "Snakefile").write_text(text, encoding="utf-8")
    run(world, sys.executable, "-m", "snakemake", "--cores", "2", "world.fan")
    same(world)


@pytest.mark.skipif(os.name == "nt", reason="no shell")
def test_open_job_description(world):
    pytest.importorskip("openjd.cli", reason="no openjd-cli for Python")
    openjd = Path(sys.executable).parent / "openjd"
    template = FARMS / "bake.openjd.yaml"
    run(world, str(openjd), "check", str(template))
    (world / "parts").mkdir()
    given = {"Model": world / "world.glb", "Output": world / "world.fan", "Parts": world / "parts"}
    given.update(Texels=TEXELS, Shards=3)
    parameters = [word for name, value in given.items() for word in ("-p", f"{name}={value}")]
    run(world, str(openjd), "run", str(template), "--step", "Merge", "--run-dependencies", *parameters)
    assert len(list((world / "parts").glob("*-of-3.part"))) == 3
    same(world)
