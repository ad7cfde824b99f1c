"""Code as people write it is traced, and gives what Python gives; scopes are known at every expression."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.repair.tracing.source import Source, read_source
from deltac.repair.tracing.tracer import branches

STYLES = {
    "class __call__": """
import numpy as np
class Sys:
    def __init__(self, m=1.2, k=3.0): self.m, self.k = m, k
    def __call__(self, t, q, u): return -self.k * q / self.m
rhs = Sys()
""",
    "partial": """
from functools import partial
import numpy as np
def f(t, q, u, *, m, k): return [-k/m*x for x in q]
rhs = partial(f, m=2.0, k=3.0)
""",
    "lambdify text": """
from numpy import sin, cos, array
def _lambdifygenerated(a, b, c, d):
    x0 = cos(a - b)
    x1 = (-1/2)*x0**2 + 3/4
    return array([[x0*sin(a)*c**2/x1, d], [x0/x1, -c*d*sin(b)]])
def rhs(t, q, u):
    M = _lambdifygenerated(*q, *u)
    return M @ u
""",
    "einsum": """
import numpy as np
C = np.arange(8.0).reshape(2, 2, 2)
def rhs(t, q, u):
    return -np.einsum("ijk,j,k->i", C, u, u) + np.einsum("ij,j", np.outer(q, q), u)
""",
    "slices inplace where": """
import numpy as np
def rhs(t, q, u):
    y = np.concatenate([q, u])
    d = np.empty_like(y)
    d[:2] = y[2:]
    d[2:] = np.where(y[:2] > 0.0, -y[:2], y[:2]**2)
    d[2:] -= 0.1 * y[2:]
    d[-1] *= 2
    return d[2:]
""",
    "dataclass field": """
from __future__ import annotations
from dataclasses import dataclass, field
import numpy as np
@dataclass(frozen=True, slots=True)
class P:
    m: float = 1.3
    I: np.ndarray = field(default_factory=lambda: np.diag([1.0, 2.0]))
    @property
    def M(self): return self.m * np.eye(2) + self.I
p = P(m=2.0)
def rhs(t, q, u): return np.linalg.solve(p.M, -q)
""",
    "generator": """
def forces(q):
    for i, x in enumerate(q):
        yield -x * (i + 1)
def rhs(t, q, u):
    acc = [0.0, 0.0]
    for i, f in enumerate(forces(q)):
        acc[i] += f
    return acc
""",
    "inherit super": """
import abc
class Base(abc.ABC):
    g = 9.81
    def __init__(self, m): self.m = m
    @abc.abstractmethod
    def force(self, q, u): ...
    def rhs(self, t, q, u):
        return [f / self.m for f in self.force(q, u)]
class Spring(Base):
    def __init__(self, m, k):
        super().__init__(m); self.__k = k
    def force(self, q, u):
        return [-self.__k * x - self.m * self.g for x in q]
rhs = Spring(2.0, k=5.0).rhs
""",
    "walrus match": """
def rhs(t, q, u):
    if (n := len(q)) != 2: raise ValueError("no")
    match n:
        case 1: return [0.0]
        case 2 | 3: return [-(s := q[0]) * s, -q[1]]
""",
    "closure nonlocal": """
def make(m=2.0):
    calls = 0
    def rhs(t, q, u):
        nonlocal calls
        calls += 1
        return [-x / m for x in q]
    return rhs
rhs = make()
""",
    "try except": """
import numpy as np
def rhs(t, q, u):
    M = np.array([[2.0, q[0]*0.1], [q[0]*0.1, 1.0]])
    try:
        return np.linalg.solve(M, -q)
    except np.linalg.LinAlgError:
        return np.zeros(2)
""",
    "cholesky": """
import numpy as np, scipy.linalg as sl
def rhs(t, q, u):
    M = np.array([[2.0, q[0]*0.1], [q[0]*0.1, 1.0]])
    return sl.cho_solve(sl.cho_factor(M), -q)
""",
    "np.vectorize": """
import numpy as np
f = np.vectorize(lambda x: -x**3)
def rhs(t, q, u): return f(q)
""",
    "dot methods": """
import numpy as np
def rhs(t, q, u):
    R = np.array([[np.cos(q[0]), -np.sin(q[0])], [np.sin(q[0]), np.cos(q[0])]])
    w = R.T.dot(u).reshape(2, 1)
    return (R @ w).ravel() - q.sum() * np.ones(2) + u.mean()
""",
    "gradient norms": """
import numpy as np
def rhs(t, q, u):
    r = np.linalg.norm(q)
    n = q / r
    return -(r - 1.0) * n - 0.1 * np.dot(u, n) * n - np.sign(u) * np.minimum(abs(u), 0.3)
""",
    "dict comp": """
from math import sin
names = ["a", "b"]
K = {f"k{n}": 2.0 + i for i, n in enumerate(names)}
def rhs(t, q, u):
    s = {n: x for n, x in zip(names, q)}
    return [-K[f"k{n}"] * sin(s[n]) for n in names]
""",
    "string dispatch": """
import operator
OPS = {"+": operator.add, "*": operator.mul}
def rhs(t, q, u):
    return [OPS["*"](-2.0, q[0]), OPS["+"](q[1], -u[1])]
""",
    "sorted sum builtins": """
def rhs(t, q, u):
    pairs = sorted(enumerate([3.0, 1.0]), key=lambda p: p[1])
    return [round(2.6) * -q[0] + pow(q[1], 2), divmod(7, 2)[0] * -q[1] + min(q[0], 0.2) + max(u)]
""",
    "np.r_ c_": """
import numpy as np
def rhs(t, q, u):
    y = np.r_[q, u]
    Z = np.c_[q, u]
    return -y[[0, 1]] + Z[:, 1] * 0.5 + np.array([y[-1], y[-2]])
""",
    "errstate": """
import numpy as np
def rhs(t, q, u):
    with np.errstate(divide="ignore"):
        a = -q / (1.0 + q**2)
    assert a.shape == (2,)
    return a.tolist()
""",
    "polyval interp": """
import numpy as np
c = [1.0, 2.0, 0.5]
def rhs(t, q, u):
    return -np.polyval(c, q)
""",
    "trapz eig": """
import numpy as np
A = np.array([[0.0, -1.0], [1.0, 0.0]])
def rhs(t, q, u):
    return np.linalg.matrix_power(A, 3) @ q - np.linalg.multi_dot([A, A, u])
""",
    "typing protocol": """
from typing import Protocol, NamedTuple, Callable
import numpy as np
class Force(Protocol):
    def __call__(self, q: np.ndarray) -> np.ndarray: ...
class Par(NamedTuple):
    k: float = 2.0
    m: float = 1.5
def spring(p: Par) -> Force:
    return lambda q: -p.k * q / p.m
F: Force = spring(Par(k=3.0))
def rhs(t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    out: np.ndarray = F(q)
    return out
""",
    "while loop const": """
def rhs(t, q, u):
    i, a = 0, [0.0, 0.0]
    while True:
        a[i] = -q[i]
        i += 1
        if i >= len(q): break
    else:
        a = None
    return a
""",
    "fsum hypot degrees": """
import math
def rhs(t, q, u):
    return [math.fsum([q[0], -u[0]]) - math.hypot(q[0], q[1], 1.0), math.radians(3.0) * -q[1]
            + math.copysign(1, u[0]) * math.fabs(q[1])]
""",
    "star args kw": """
def g(a, *rest, scale=1.0, **kw):
    return sum(rest, a) * scale + kw.get("bias", 0.0)
def rhs(t, q, u):
    kw = dict(scale=-2.0, bias=0.1)
    return [g(*q, **kw), g(u[0], u[1], scale=0.5)]
""",
    "global mutable cache": """
import functools
@functools.lru_cache(maxsize=None)
def coeff(n): return 1.0 / (n + 1)
def rhs(t, q, u):
    return [-coeff(i) * x for i, x in enumerate(q)]
""",
    "enum config": """
from enum import Enum
class Mode(Enum):
    LIN = "lin"; CUB = "cub"
MODE = Mode("cub")
def rhs(t, q, u):
    return [-x**3 if MODE is Mode.CUB else -x for x in q]
""",
    "operator overloading": """
import numpy as np
class Vec:
    def __init__(self, x, y): self.x, self.y = x, y
    def __add__(self, o): return Vec(self.x + o.x, self.y + o.y)
    def __rmul__(self, s): return Vec(s * self.x, s * self.y)
    def __neg__(self): return Vec(-self.x, -self.y)
    def __iter__(self): return iter((self.x, self.y))
    def __matmul__(self, o): return self.x * o.x + self.y * o.y
    def __getitem__(self, i): return (self.x, self.y)[i]
def rhs(t, q, u):
    a = Vec(*q); b = Vec(*u)
    c = 2.0 * (-a) + b
    return [c[0] * (a @ b), list(c)[1]]
""",
}

COMPILED = {
    "jax": """
import jax
import jax.numpy as jnp
@jax.jit
def rhs(t, q, u):
    x = jnp.array([jnp.sin(q[0]), -u[1]])
    return jnp.clip(x, -0.5, 0.5)
""",
    "numba": """
import numpy as np
from numba import njit, prange
@njit(cache=True)
def kernel(q, u, out):
    for i in prange(len(q)):
        out[i] = np.sin(q[i]) if i == 0 else -u[i]
@njit
def rhs(t, q, u):
    out = np.zeros(2)
    kernel(q, u, out)
    return np.clip(out, -0.5, 0.5)
""",
}


def states() -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(0)
    return rng.random(6), rng.uniform(-1, 1, (2, 6)), rng.standard_normal((2, 6))


def traced(text: str) -> Any:
    t, q, u = states()
    found = np.full((2, len(t)), np.nan)
    for which, way in branches(Source("eom.py", text, "rhs"), t, q, u):
        found[:, which] = way.tape.run(way.outputs)
    return found


@pytest.mark.parametrize("style", STYLES)
def test_a_style_is_traced_as_python_runs_it(style: str) -> None:
    t, q, u = states()
    namespace: dict[str, Any] = {"__name__": "eom"}
    text = STYLES[style].replace("from __future__ import annotations\n", "")
    exec(compile(text, "eom.py", "exec", dont_inherit=True), namespace)
    want = [namespace["rhs"](t[b], q[:, b].copy(), u[:, b].copy()) for b in range(len(t))]
    # the same operations in the same order, but for sums and squares: some ulps
    np.testing.assert_allclose(traced(STYLES[style]), np.array(want, dtype=float).T, rtol=1e-12)


@pytest.mark.parametrize("style", COMPILED)
def test_compilers_need_not_be_installed(style: str) -> None:
    _, q, u = states()
    want = np.clip([np.sin(q[0]), -u[1]], -0.5, 0.5)
    np.testing.assert_allclose(traced(COMPILED[style]), want, rtol=1e-14)


def test_a_property_leaves_what_is_in_scope() -> None:
    text = """
class P:
    m = 2.0
    @property
    def double(self):
        inner = 2 * self.m
        return inner
p = P()
def rhs(t, q, u):
    k = 3.0
    return [-p.double * q[0] - k, q[1]]
"""
    ((_, way),) = branches(Source("eom.py", text, "rhs"), *states())
    nodes = way.source.nodes
    for place, instances in way.instances.items():
        if getattr(nodes[place], "lineno", 0) == 11:
            assert all("k" in i.scope and "inner" not in i.scope for i in instances)


@pytest.mark.parametrize(
    "line",
    [
        "for k in itertools.count(): pass",
        "x = [k for k in itertools.cycle([1.0])]",
        "np.savetxt('a.txt', [1.0])",
        "x = np.random.normal()",
        "eval('1')",
        "import subprocess; subprocess.run(['true'])",
    ],
)
def test_what_has_effects_or_no_end_is_refused(line: str) -> None:
    text = f"import itertools\nimport numpy as np\ndef rhs(t, q, u):\n    {line}\n    return q\n"
    with pytest.raises(InputError, match=r"eom\.py"):
        branches(Source("eom.py", text, "rhs"), *states())


@pytest.mark.parametrize(
    "statement",
    [
        "np.zeros = 3",
        "del np.zeros",
        "setattr(np, 'zeros', 3)",
        "np.__dict__['zeros'] = 3",
        "vars(np)['zeros'] = 3",
        "for np.zeros in [3]: pass",
        "np.zeros, x = 3, 4",
        "np.linalg.solve.deltac = 3",
    ],
)
def test_what_others_use_too_is_not_changed(statement: str, tmp_path: Path) -> None:
    """The function is run in this process, and NumPy is everyone's."""
    before = (np.zeros, dict(vars(np.linalg.solve)))
    path = tmp_path / "setting.py"
    path.write_text(
        f"import numpy as np\ndef rhs(t, q, u):\n    {statement}\n    return -q\n", "utf-8"
    )
    with pytest.raises(InputError):
        branches(read_source(f"{path}:rhs"), np.zeros(2), np.ones((1, 2)), np.ones((1, 2)))
    assert (np.zeros, dict(vars(np.linalg.solve))) == before
