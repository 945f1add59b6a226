"""`parametrize`: nothing is left out, nothing overlaps, nothing hangs."""

import numpy as np
import pytest

import fantex


def check(positions, faces, result):
    """What holds of every unwrapping."""
    vmapping, new_faces, uvs = result
    assert vmapping.dtype == np.uint32 and new_faces.dtype == np.uint32 and uvs.dtype == np.float32
    assert new_faces.shape == np.shape(faces) and uvs.shape == (len(vmapping), 2)
    np.testing.assert_array_equal(vmapping[new_faces], faces)
    assert uvs.min(initial=0) >= 0 and uvs.max(initial=0) <= 1


def coverage(faces, uvs, size=(1024, 1024)):
    """How often each texel's centre lies in a triangle."""
    count = np.zeros(size[::-1], np.int32)
    for a, b, c in (uvs[faces] * np.array(size)).astype(np.float64):
        low = np.maximum(np.floor(np.minimum(np.minimum(a, b), c)).astype(int), 0)
        high = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c)).astype(int), size)
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)

        def left(p, q):
            return (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])

        sides = np.stack([left(a, b), left(b, c), left(c, a)])
        inside = (sides > 1e-4).all(0) | (sides < -1e-4).all(0)
        count[low[1] : high[1], low[0] : high[0]] += inside
    return count


def test_sphere(sphere):
    positions, faces = sphere
    result = fantex.parametrize(positions, faces)
    check(positions, faces, result)
    texels = coverage(result[1], result[2])
    assert texels.max() == 1, "triangles overlap"
    assert texels.mean() > 0.45, texels.mean()
    assert 1 < result.charts < 40
    # Triangles of one chart all have the same turn, and none is mirrored.
    a, b, c = result[2][result[1]].transpose(1, 0, 2).astype(np.float64)
    signed = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (signed > -1e-9).all()


def test_a_cube_fills_a_picture_of_its_own_shape():
    positions = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for square, least in ((True, 0.64), (False, 0.97)):
        result = fantex.parametrize(positions, faces, resolution=512, square=square)
        check(positions, faces, result)
        assert result.side == max(result.size) and result.size[0] * result.size[1] <= 512**2
        assert (result.size[0] == result.size[1]) == square
        texels = coverage(result[1], result[2], result.size)
        assert texels.max() == 1 and texels.mean() > least, texels.mean()


@pytest.mark.parametrize("seed", range(6))
def test_dirty_soups(seed):
    random = np.random.default_rng(seed)
    positions = random.normal(size=(60, 3))
    positions[5] = positions[6]
    positions[7] = np.nan
    positions[8] = np.inf
    positions[9] = positions[10] + 1e-12
    faces = random.integers(0, 60, (150, 3))
    faces = np.concatenate([faces, faces[:20], faces[20:40, [1, 2, 0]], faces[40:60, ::-1]])
    result = fantex.parametrize(positions, faces)
    check(positions, faces, result)
    texels = coverage(result[1], result[2], (512, 512))
    # Only repeated faces lie on each other.
    assert (texels > 3).sum() == 0


def test_repeated_faces_share_coordinates():
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]], float)
    faces = np.array([[0, 1, 2], [1, 2, 0], [1, 3, 2], [2, 0, 1], [0, 0, 1]])
    vmapping, new_faces, uvs = fantex.parametrize(positions, faces)
    check(positions, faces, (vmapping, new_faces, uvs))
    by_vertex = [{v: tuple(uvs[n]) for v, n in zip(row, new)} for row, new in zip(faces, new_faces)]
    assert by_vertex[0] == by_vertex[1] == by_vertex[3]
    assert len(set(map(tuple, uvs[new_faces[4]]))) == 1


def test_nothing_to_unwrap_is_no_failure():
    for positions, faces in [(np.zeros((3, 3)), [[0, 1, 2]]), (np.full((3, 3), np.nan), [[0, 1, 2]]), (np.eye(3), [])]:
        result = fantex.parametrize(positions, faces)
        check(positions, np.reshape(faces, (-1, 3)), result)
        assert result.charts == 0


def test_many_loose_triangles_fit():
    random = np.random.default_rng(3)
    positions = random.normal(size=(60_000, 3)).astype(np.float32)
    positions[1::3] = positions[::3] + random.normal(size=(20_000, 3)) * 0.01
    positions[2::3] = positions[::3] + random.normal(size=(20_000, 3)) * 0.01
    faces = np.arange(60_000).reshape(-1, 3)
    result = fantex.parametrize(positions, faces, resolution=64)
    check(positions, faces, result)
    assert result.side >= 512


def test_as_xatlas_is_called(sphere):
    positions, faces = sphere
    normals = positions.astype(np.float32)
    result = fantex.parametrize(positions.astype(np.float32), faces.astype(np.uint32), normals)
    vmapping, indices, uvs = result
    check(positions, faces, (vmapping, indices, uvs))
    again = fantex.parametrize(positions.astype(np.float32), faces.astype(np.uint32), normals, normals[:, :2])
    np.testing.assert_array_equal(again[2], uvs)


def test_progress_is_told_and_may_end_it(sphere):
    told = []
    fantex.parametrize(*sphere, progress=lambda *state: told.append(state))
    assert told[-1][0] == told[-1][1] > 2000

    def enough(done, total):
        raise StopIteration("enough")

    with pytest.raises(StopIteration, match="enough"):
        fantex.parametrize(*sphere, progress=enough)


def test_wrong_arguments(sphere):
    positions, faces = sphere
    with pytest.raises(ValueError, match="power of two"):
        fantex.parametrize(positions, faces, resolution=1000)
    with pytest.raises(ValueError, match="cannot unwrap the mesh: triangle|face 0"):
        fantex.parametrize(positions, faces + 10_000)
