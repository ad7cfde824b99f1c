"""Shapes, layouts, parameters, bitwise reproducibility, and what a user gets wrong."""

from __future__ import annotations

import gc
import importlib.util
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi
import numpy as np
import pytest

from deltac.errors import InputError
from deltac.kernels import Kernel, evaluator_name
from deltac.kernels.parallel import spread
from deltac.kernels.simd import LINE, aligned


def pendulum() -> Kernel:
    """Double-pendulum-like expressions: a scalar, a column and a matrix of two inputs and time."""
    t, q, u = casadi.SX.sym("t"), casadi.SX.sym("q", 2), casadi.SX.sym("u", 2)
    s, c = casadi.sin(q), casadi.cos(q)
    mass = casadi.blockcat([[3 + 2 * c[1], 1 + c[1]], [1 - c[1], 1]])
    force = casadi.vertcat(s[0] * u[1] ** 2 - t, casadi.exp(-t) * u[0])
    outputs = {
        "energy": casadi.dot(u, mass @ u) / 2,
        "force": force,
        "jacobian": casadi.horzcat(mass, force),
    }
    return Kernel({"t": t, "q": q, "u": u}, outputs, name="pendulum")


def by_hand(t: np.ndarray, q: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
    c = np.cos(q[:, 1])
    mass = np.stack([np.stack([3 + 2 * c, 1 + c], -1), np.stack([1 - c, np.ones_like(c)], -1)], 1)
    force = np.stack([np.sin(q[:, 0]) * u[:, 1] ** 2 - t, np.exp(-t) * u[:, 0]], -1)
    energy = np.einsum("ti,tij,tj->t", u, mass, u) / 2
    jacobian = np.concatenate([mass, force[:, :, None]], axis=2)
    return {"energy": energy, "force": force, "jacobian": jacobian}


@pytest.mark.parametrize("times", [1, 2, 257, 600])
def test_named_arrays(evaluator: str, times: int) -> None:
    rng = np.random.default_rng(times)
    t, q, u = rng.normal(size=times), rng.normal(size=(times, 2)), rng.normal(size=(times, 2))
    found, expected = pendulum()(t=t, q=q, u=u), by_hand(t, q, u)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name].shape == value.shape
        # A dozen operations on numbers of order 10: some tens of ulp.
        np.testing.assert_allclose(found[name], value, rtol=1e-14, atol=1e-14)


def test_constant_inputs_are_broadcast(evaluator: str) -> None:
    kernel = pendulum()
    t = np.linspace(0, 1, 5)
    spread = kernel(t=t, q=np.tile([0.1, 0.2], (5, 1)), u=np.tile([1.0, 2.0], (5, 1)))
    short = kernel(t=t, q=[0.1, 0.2], u=[[1.0, 2.0]])
    np.testing.assert_array_equal(short["jacobian"], spread["jacobian"])
    assert kernel(t=0.0, q=[0, 0], u=[0, 0])["force"].shape == (1, 2)
    assert kernel(t=[], q=np.empty((0, 2)), u=[0, 0])["energy"].shape == (0,)


def test_layout_is_as_declared(evaluator: str) -> None:
    kernel = pendulum()
    assert kernel.input_names == ("t", "q", "u")
    assert tuple(kernel.output_slices) == ("energy", "force", "jacobian")
    assert kernel.input_slices == {"t": slice(0, 1), "q": slice(1, 3), "u": slice(3, 5)}
    assert (kernel.n_in, kernel.n_out, kernel.n_parameters) == (5, 9, 0)
    x = np.random.default_rng(0).normal(size=(5, 12))
    y = kernel.flat(x)
    named = kernel(t=x[0], q=x[1:3].T, u=x[3:].T)
    where = kernel.output_slices["jacobian"]
    np.testing.assert_array_equal(y[where][2 * 2 + 1], named["jacobian"][:, 1, 2])


def test_single_agrees_with_batch(evaluator: str) -> None:
    kernel = pendulum()
    x = np.random.default_rng(5).normal(size=(20, 5))
    rows = np.stack([kernel.single(row, np.empty(9)) for row in x])
    np.testing.assert_allclose(rows, kernel.flat(x.T).T, rtol=1e-14, atol=1e-14)
    again = np.stack([kernel.single(row, np.empty(9)) for row in x])
    np.testing.assert_array_equal(rows, again)


def test_single_reads_new_values_in_the_same_arrays(evaluator: str) -> None:
    x = casadi.SX.sym("x", 2)
    kernel = Kernel({"x": x}, {"y": x[0] * x[1]})
    state, out = np.array([2.0, 3.0]), np.empty(1)
    assert kernel.single(state, out)[0] == 6.0
    state[:] = 5.0, 7.0
    assert kernel.single(state, out)[0] == 35.0
    assert kernel.single(np.array([1.0, 4.0]), out)[0] == 4.0


@pytest.mark.long
def test_a_call_bound_to_its_arrays(evaluator: str) -> None:
    x, p = casadi.SX.sym("x", 2), casadi.SX.sym("p")
    kernel = Kernel({"x": x}, {"y": p * x[0] + x[1]}, p)
    there, back, parameter = np.array([1.0, 2.0, 0.0]), np.array([0.0, 5.0, 0.0]), np.array([3.0])
    calls = [kernel.bound(a[:2], b[2:], parameter) for a, b in ((there, back), (back, there))]
    del kernel
    gc.collect()
    for call in calls * 2:
        call()
    assert (back[2], there[2]) == (5.0, 5.0)
    parameter[0] = there[0] = 7.0
    calls[0]()
    assert back[2] == 51.0
    with pytest.raises(InputError):
        Kernel({"x": x}, {"y": p * x[0]}, p).bound(np.ones(3), np.ones(1), parameter)


@pytest.mark.parametrize("shape", [(3,), (1,)])
def test_single_refuses_arrays_that_do_not_fit(evaluator: str, shape: tuple[int, ...]) -> None:
    x = casadi.SX.sym("x", 2)
    kernel = Kernel({"x": x}, {"y": x[0] * x[1]})
    with pytest.raises(ValueError, match=r"2|shape"):
        kernel.single(np.ones(shape), np.empty(1))
    with pytest.raises((ValueError, TypeError)):
        kernel.single(np.ones(2, dtype=np.float32), np.empty(1))


def rough() -> Kernel:
    """Functions whose scalar and vector code differ in the last bits."""
    x, p = casadi.SX.sym("x", 3), casadi.SX.sym("p")
    y = x
    for _ in range(6):
        y = casadi.sin(p * y) + casadi.exp(casadi.cos(y[[1, 2, 0]])) / (1 + y**2)
    return Kernel({"x": x}, {"y": y}, p)


def test_bits_do_not_depend_on_where_a_batch_is_cut(evaluator: str) -> None:
    kernel = rough()
    x = np.random.default_rng(1).normal(size=(3, 5003))
    p = np.random.default_rng(2).normal(size=(1, 5003))
    whole = kernel.flat(x, p)
    for size in (1, 2, 3, 5, 7, 8, 63, 1000, 2501):
        starts = range(0, 5003, size) if size > 60 else range(0, 100, size)
        for start in starts:
            cut = slice(start, start + size)
            np.testing.assert_array_equal(kernel.flat(x[:, cut], p[:, cut]), whole[:, cut])
    shuffled = np.random.default_rng(3).permutation(5003)
    np.testing.assert_array_equal(kernel.flat(x[:, shuffled], p[:, shuffled]), whole[:, shuffled])


def test_one_state_as_many(evaluator: str) -> None:
    """Scalar code fuses products and sums as vector code does."""
    kernel = rough()
    x = np.random.default_rng(1).normal(size=(3, 400))
    one = np.stack([kernel.single(c.copy(), np.empty(3), np.ones(1)) for c in x.T], axis=1)
    np.testing.assert_allclose(one, kernel.flat(x, [1.0]), rtol=1e-12)


def test_bits_do_not_depend_on_threads(evaluator: str) -> None:
    kernel = rough()
    x = np.random.default_rng(1).normal(size=(3, 10_003))
    whole = kernel.flat(x, [1.0])
    found = np.empty_like(whole)

    def part(rows: slice) -> None:
        found[:, rows] = kernel.flat(x[:, rows], [1.0])

    spread(part, [slice(k, k + 1000) for k in range(0, 10_003, 1000)], threads=3)
    np.testing.assert_array_equal(found, whole)


def test_out_is_used(evaluator: str) -> None:
    kernel = pendulum()
    x = np.random.default_rng(0).normal(size=(5, 7))
    out = np.empty((9, 7))
    assert kernel.flat(x, out=out) is out
    np.testing.assert_array_equal(out, kernel.flat(np.asfortranarray(x)))
    with pytest.raises(InputError, match=r"out has shape \(9, 6\)"):
        kernel.flat(x, out=np.empty((9, 6)))


def with_parameters() -> Kernel:
    x, p = casadi.SX.sym("x"), casadi.SX.sym("p", 3)
    return Kernel({"x": x}, {"y": p[0] * x + p[1]}, p)  # the last one does not occur


def test_parameters(evaluator: str) -> None:
    kernel = with_parameters()
    x = np.arange(6.0)
    np.testing.assert_array_equal(kernel([2.0, 1.0, 9.0], x=x)["y"], 2 * x + 1)
    each = np.stack([x, 10 * x, x], axis=1)
    np.testing.assert_array_equal(kernel(each, x=x)["y"], x * x + 10 * x)
    np.testing.assert_array_equal(kernel.flat(x[None], each.T)[0], x * x + 10 * x)
    assert kernel.single(np.array([3.0]), np.empty(1), np.array([2.0, 1.0, 0.0]))[0] == 7.0


def test_parameters_that_never_occur(evaluator: str) -> None:
    x, p = casadi.SX.sym("x"), casadi.SX.sym("p", 2)
    kernel = Kernel({"x": x}, {"y": x + 1}, p)
    assert kernel([0.0, 0.0], x=1.0)["y"] == [2.0]
    assert kernel.single(np.ones(1), np.empty(1), np.ones(2))[0] == 2.0


def test_missing_or_misshapen_parameters(evaluator: str) -> None:
    kernel = with_parameters()
    with pytest.raises(InputError, match=r"parameters have shape \(0,\), expected \(3,\)"):
        kernel(x=1.0)
    with pytest.raises(InputError, match=r"parameters have shape \(2,\)"):
        kernel([1.0, 2.0], x=1.0)
    with pytest.raises(InputError, match="parameters expected"):
        kernel.single(np.ones(1), np.empty(1))
    with pytest.raises(InputError, match=r"parameters have shape \(1,\), expected \(0,\)"):
        pendulum()([1.0], t=0, q=[0, 0], u=[0, 0])


def test_outputs_may_be_empty(evaluator: str) -> None:
    x = casadi.SX.sym("x", 2)
    found = Kernel({"x": x}, {"none": casadi.SX(0, 1), "x": x})(x=np.ones((4, 2)))
    assert found["none"].shape == (4, 0)
    assert Kernel({"x": x}, {})(x=[1, 2]) == {}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"t": 0, "q": [0, 0]}, "input 'u' is missing"),
        ({"t": 0, "q": [0, 0], "u": [0, 0], "qq": 1}, "unknown input 'qq'"),
        ({"t": 0, "q": [0, 0, 0], "u": [0, 0]}, r"input 'q' has shape \(3,\), expected \(T, 2\)"),
        ({"t": [[0, 1]], "q": [0, 0], "u": [0, 0]}, r"input 't' has shape \(1, 2\)"),
        ({"t": [0, 1, 2], "q": np.zeros((4, 2)), "u": [0, 0]}, "'t': 3, 'q': 4"),
    ],
)
def test_wrong_arrays_are_named(arrays: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"pendulum: .*{message}"):
        pendulum()(**arrays)


def test_wrong_expressions_are_named() -> None:
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    with pytest.raises(InputError, match="output 'z' depends on y, which is in neither"):
        Kernel({"x": x}, {"z": x + y})
    with pytest.raises(InputError, match="input 'x' is .*expected a column of symbols"):
        Kernel({"x": x + 1}, {"z": x})
    with pytest.raises(InputError, match="symbol x occurs twice"):
        Kernel({"x": x, "again": x}, {"z": x})
    with pytest.raises(InputError, match="no inputs"):
        Kernel({}, {"z": casadi.SX(1)})


def test_common_subexpressions_are_computed_once() -> None:
    x = casadi.SX.sym("x")
    outputs = {f"y{k}": casadi.sin(x * x) + k for k in range(10)}
    # One input, one square, one sine; ten constants, sums and outputs, but for y0 without a sum.
    assert Kernel({"x": x}, outputs).instructions <= 1 + 2 + 30


def in_new_process(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_environment_forces_the_evaluator() -> None:
    code = (
        "import sys, casadi; from deltac.kernels import Kernel, evaluator_name;"
        "x = casadi.SX.sym('x'); print(Kernel({'x': x}, {'y': 2 * x})(x=21.0)['y'][0]);"
        "print(evaluator_name(), 'llvmlite' in sys.modules)"
    )
    run = in_new_process(code, DELTAC_EVALUATOR="casadi")
    assert run.stdout.split() == ["42.0", "casadi", "False"], run.stderr


@pytest.mark.long
def test_without_a_compiler_kernels_are_interpreted_and_it_is_said() -> None:
    code = (
        "import sys, warnings, casadi, deltac;"
        "from deltac.kernels import Kernel, evaluator_name;"
        "from deltac.kernels.evaluators import EvaluatorWarning;"
        "BREAK;"
        "x = casadi.SX.sym('x'); warnings.simplefilter('always');"
        "seen = warnings.catch_warnings(record=True); told = seen.__enter__();"
        "found = [Kernel({'x': x}, {'y': k * x})(x=21.0)['y'][0] for k in (1, 2)];"
        "print(found[1], [str(w.message)[:9] for w in told if w.category is EvaluatorWarning])"
    )
    missing = "import importlib.util as u; u.find_spec = lambda name: None"
    run = in_new_process(code.replace("BREAK", missing), DELTAC_EVALUATOR="")
    assert run.stdout.strip() == "42.0 ['llvmlite ']", run.stderr
    if importlib.util.find_spec("llvmlite") is None:
        return
    broken = "import llvmlite.binding as b; b.create_lljit_compiler = lambda *_, **__: 1 / 0"
    broken = broken.replace("1 / 0", "(_ for _ in ()).throw(RuntimeError('no'))")
    run = in_new_process(code.replace("BREAK", broken), DELTAC_EVALUATOR="")
    assert run.stdout.strip() == "42.0 ['LLVM does']", run.stderr
    run = in_new_process(code.replace("BREAK", broken), DELTAC_EVALUATOR="llvm")
    assert "RuntimeError: no" in run.stderr


def test_unknown_evaluator_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_EVALUATOR", "lvm")
    with pytest.raises(InputError, match="'lvm'; did you mean 'llvm'"):
        evaluator_name()


def test_named_evaluation_in_blocks_is_the_flat_one(evaluator: str) -> None:
    x, p = casadi.SX.sym("x", 2), casadi.SX.sym("p")
    outputs = {"column": p * x, "matrix": x @ x.T + p, "scalar": x[0] / p, "none": casadi.SX(0, 1)}
    kernel = Kernel({"x": x}, outputs, p)
    rng = np.random.default_rng(1)
    rows, values = rng.normal(size=(2500, 2)), rng.uniform(1, 2, size=(2500, 1))
    for parameters in (values, values[7]):
        flat = kernel.flat(rows.T, parameters.T)
        found = kernel(parameters, x=rows)
        np.testing.assert_array_equal(found["column"], flat[:2].T)
        np.testing.assert_array_equal(
            found["matrix"], flat[2:6].T.reshape(-1, 2, 2).transpose(0, 2, 1)
        )
        np.testing.assert_array_equal(found["scalar"], flat[6])
        assert found["none"].shape == (2500, 0)
    with pytest.raises(InputError, match=r"parameters have shape \(2499, 1\).*\(2500, 1\)"):
        kernel(values[1:], x=rows)


# --- over and over ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 7, 5000])
def test_iterating_keeps_every_result(count: int) -> None:
    """x ← a x + b with a and b in turn, and beside it a count, against NumPy's own loop."""
    x, k, p = casadi.SX.sym("x", 2), casadi.SX.sym("k"), casadi.SX.sym("p", 2)
    kernel = Kernel({"x": x, "k": k}, {"x": p[0] * x + p[1] * casadi.sin(k), "k": k + 1}, p)
    in_turn = np.array([[0.5, 1.0], [-0.25, 2.0], [0.75, -1.0]])
    found = kernel.iterate(np.array([1.0, 2.0, 0.0]), count, in_turn)
    expected, now = [], np.array([1.0, 2.0])
    for n in range(count):
        a, b = in_turn[n % 3]
        now = a * now + b * np.sin(float(n))
        expected.append([*now, n + 1.0])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
    again = kernel.iterate(found[-1], 3, in_turn)  # goes on from anywhere
    assert again[-1, 2] == count + 3


def test_iterating_is_the_same_from_many_threads() -> None:
    x = casadi.SX.sym("x", 3)
    kernel = Kernel({"x": x}, {"x": casadi.sin(x) + 0.1 * casadi.sum1(x)})
    starts = np.linspace(-1.0, 1.0, 24).reshape(8, 3)
    alone = [kernel.iterate(start, 3000) for start in starts]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda start: kernel.iterate(start, 3000), starts))
    np.testing.assert_array_equal(together, alone)


def test_iterating_needs_as_many_outputs_as_inputs() -> None:
    x, p = casadi.SX.sym("x", 2), casadi.SX.sym("p")
    with pytest.raises(InputError, match="as many"):
        Kernel({"x": x}, {"y": x[0]}).iterate(np.zeros(2), 3)
    with pytest.raises(InputError, match="parameters"):
        Kernel({"x": x}, {"x": p * x}, p).iterate(np.zeros(2), 3)


@pytest.mark.long
@pytest.mark.skipif(evaluator_name() != "llvm", reason="of compiled kernels")
def test_kernels_outlive_their_linker() -> None:
    """A linker loads some kernels only; those of earlier ones go on working."""
    from deltac.kernels.llvm_evaluator import LOADS

    x = casadi.SX.sym("x", 2)
    kept = Kernel({"x": x}, {"y": casadi.sin(x)}, name="kept")
    points = np.array([[0.1, 0.2], [0.3, -0.4]])
    first = kept(x=points)
    for _ in range(3 * LOADS):
        Kernel({"x": x}, {"y": casadi.cos(x)}, name="gone")(x=points)
    gc.collect()
    again = kept(x=points)
    np.testing.assert_array_equal(again["y"], first["y"])
    np.testing.assert_allclose(again["y"], np.sin(points), rtol=4 * np.finfo(float).eps)


def test_a_bound_batch_is_the_batch_of_its_arrays(evaluator: str) -> None:
    x = casadi.SX.sym("x", 9)
    kernel = Kernel({"x": x}, {"y": 2.0 * x})
    columns, doubled = aligned(9, 16), aligned(9, 16)
    assert columns.ctypes.data % LINE == 0
    call = kernel.bound_batch(columns, doubled)
    for value in (1.0, -3.0):
        columns[:] = value * np.arange(144.0).reshape(9, 16)
        call()
        np.testing.assert_array_equal(doubled, 2.0 * columns)
