"""The same seed gives the same episode whichever loops a BLAS has for the processor."""

from __future__ import annotations

import ast
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import mpvi_bt

PACKAGE = Path(mpvi_bt.__file__).parent
# Exceptions: reports decide nothing; meshes are imported once, into a file; learned eyes see alike on one machine only
# (docs/eyes.md).
NOT_DECIDING = {
    "runs/report",
    "house/things/mesh_import.py",
    "house/things/mesh_parts.py",
    "finding/eyes/eyes_network.py",
}
DECIDING = [
    path
    for path in sorted(PACKAGE.rglob("*.py"))
    if not {path.relative_to(PACKAGE).parent.as_posix(), path.relative_to(PACKAGE).as_posix()} & NOT_DECIDING
]

# Calls of numpy and scipy that use a BLAS or a LAPACK. `linear_algebra.py` and `rotations.py` of `ground/geometry`
# have the like.
CALLS = {"linalg", "dot", "from_matrix", "align_vectors"}  # of whatever has it
OF_NUMPY = {
    *("vdot", "inner", "matmul", "tensordot", "einsum", "vecdot", "matvec", "vecmat"),
    *("convolve", "correlate", "cov", "corrcoef", "polyfit"),
}
# Of scipy, what was seen to call neither.
FREE = {
    *("scipy.ndimage", "scipy.sparse.csgraph.dijkstra", "scipy.optimize.linear_sum_assignment"),
    *("scipy.sparse.coo_matrix", "scipy.sparse.csgraph.connected_components"),
    *("scipy.spatial.KDTree", "scipy.spatial.cKDTree", "scipy.spatial.ConvexHull", "scipy.spatial.QhullError"),
    "scipy.special.erf",
    "scipy.spatial.transform.Rotation",
}

# Loops of OpenBLAS without AVX, with it, and with fused multiply-add; each with what the processor must have.
KERNELS = {"Prescott": "pni", "Sandybridge": "avx", "Haswell": "avx2"}


def calls(path: Path) -> Iterator[str]:
    """What a file takes of a BLAS, as "line: what"."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            yield f"{node.lineno}: @"
        elif isinstance(node, ast.Attribute) and (
            node.attr in CALLS or (ast.unparse(node.value) == "np" and node.attr in OF_NUMPY)
        ):
            yield f"{node.lineno}: {ast.unparse(node)}"
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in ("numpy", "scipy"):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            yield from (f"{node.lineno}: {n}" for n in sorted(names - FREE) if n.startswith("scipy"))
            yield from (f"{node.lineno}: {n}" for n in sorted(names) if set(n.split(".")) & (CALLS | OF_NUMPY))
        elif isinstance(node, ast.Import):
            yield from (f"{node.lineno}: {a.name}" for a in node.names if a.name.startswith(("scipy", "numpy.")))


def test_what_decides_calls_no_blas() -> None:
    """No module that decides multiplies by BLAS: it rounds otherwise on another processor.

    `matmul`, `norm`, `principal_axes` and `least_squares` of `linear_algebra.py` do not, nor does `rotation`.
    """
    found = [f"{path.relative_to(PACKAGE)}:{call}" for path in DECIDING for call in calls(path)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "line",
    [
        "a @ b", "a @= b", "np.linalg.norm(a)", "a.dot(b)", "np.convolve(a, b)", "from numpy.linalg import svd",
        "from scipy.linalg import expm", "from scipy import signal", "import scipy.linalg", "Rotation.from_matrix(R)",
    ],
)  # fmt: skip
def test_what_calls_a_blas_is_noticed(line: str, tmp_path: Path) -> None:
    """The law above sees each form of such a call."""
    path = tmp_path / "some.py"
    path.write_text(line)
    assert list(calls(path))


def under_each_kernel(code: str) -> list[str]:
    """What a program prints under each kernel, the first line of each being what BLAS itself makes of a product.

    Skips where the processor has not all of them, or numpy's BLAS takes no notice: there would be nothing to compare.
    """
    flags = Path("/proc/cpuinfo")
    if platform.machine() != "x86_64" or not flags.exists():
        pytest.skip("the kernels are those of x86-64 under Linux")
    if missing := [k for k, flag in KERNELS.items() if flag not in flags.read_text().split()]:
        pytest.skip(f"the processor has nothing for {missing}")
    running = [
        subprocess.Popen(
            [sys.executable, "-c", OWN_PRODUCT + code], stdout=subprocess.PIPE, text=True,
            env={**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"},
        )
        for kernel in KERNELS
    ]  # fmt: skip
    said = [process.communicate()[0].split("\n", 1) for process in running]
    assert [process.returncode for process in running] == [0] * len(KERNELS)
    if len({own for own, _ in said}) == 1:
        pytest.skip("numpy's BLAS has one kernel here, whatever OPENBLAS_CORETYPE says")
    return [rest for _, rest in said]


OWN_PRODUCT = """
import hashlib, numpy as np
def digest(*arrays):
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
A, B = np.random.default_rng(0).normal(size=(2, 30, 30))
print(digest(A @ B))
"""

ALGEBRA = """
from mpvi_bt.ground.geometry.linear_algebra import least_squares, matmul, norm, principal_axes
from mpvi_bt.ground.geometry.rotations import rotation
from scipy.spatial.transform import Rotation
points, R = np.random.default_rng(1).normal(size=(500, 3)), Rotation.random(9, rng=2).as_matrix()
R32 = R.astype(np.float32).astype(float)  # as of a simulator: not quite orthogonal
print(digest(matmul(A, B), matmul(A, A[0]), matmul(A[0], B), matmul(A[0], A[1]), norm(A), norm(A[0]), matmul(R, R[0])))
print(digest(*principal_axes(points), least_squares(points, points[:, 0] ** 2), rotation(R32).as_quat()))
"""

EPISODE = """
from mpvi_bt.executive.ticking.loop import Watcher
from mpvi_bt.runs.episode import episode
from mpvi_bt.runs.choices.config import EpisodeConfig

class Steps(Watcher):
    def __init__(self):
        self.told = hashlib.sha256()
    def step(self, tree, world):
        poses = [world.pose(e.name) for e in world.knowledge() if e.kind == "object"] if world.steps % 30 == 0 else []
        self.told.update(digest(world.robot.action, *poses).encode())
        if world.steps == {steps}:
            raise KeyboardInterrupt

steps = Steps()
config = EpisodeConfig("picking_up_trash", policy="{policy}", checker="{checker}")
result = episode.run(config, [steps])
result.pop("wall")
print(steps.told.hexdigest(), result)
"""


def test_the_small_algebra_is_the_same_under_every_kernel() -> None:
    """Products, lengths, axes, systems and rotations: bit for bit."""
    assert len(set(under_each_kernel(ALGEBRA))) == 1


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize(("policy", "checker", "steps"), [("expert", "oracle", 300), ("reactive", "visual", 500)])
def test_an_episode_is_the_same_under_every_kernel(policy: str, checker: str, steps: int) -> None:
    """Commands, places and the result of an episode's first seconds: bit for bit, by each policy that ships."""
    # Before `linear_algebra` was, the expert parted at step 207, with the first way of an arm.
    code = EPISODE
    for name, value in {"policy": policy, "checker": checker, "steps": str(steps)}.items():
        code = code.replace(f"{{{name}}}", value)
    told = under_each_kernel(code)
    assert "interrupted" in told[0]
    assert len(set(told)) == 1
