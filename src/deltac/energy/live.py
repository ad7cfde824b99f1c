"""A balance that goes along with a simulation: one compiled step of it, in constant memory.

The rules are those of `balance`. Powers are integrated over each interval through its two ends ("hermite 2":
the motion by Hermite's polynomial, logged forces linearly between the rows), and the error bar comes from
leaving out every second row. Forces that were held over a step do the work fᵀ∫u dt of that step.
All of it, the sums included, is one kernel: a call for each row.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from deltac.arrays import EPS, Array
from deltac.calls.caching import LRUCache
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.independence import dependent_speeds
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import MOMENTUM, testing_functions
from deltac.energy.sampling.interpolation import hermite_kernel
from deltac.energy.sampling.quadrature import HERMITE_ORDERS, INNER, INNER_WEIGHTS, OUTER_WEIGHT
from deltac.energy.terms import LoggedForces, ledger_kernels, ledger_symbols
from deltac.kernels import Kernel
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism

LOBATTO_NODES = (0.0, *INNER, 1.0)
LOBATTO_WEIGHTS = (OUTER_WEIGHT, *INNER_WEIGHTS, OUTER_WEIGHT)

GIVEN = ChannelName("applied", "given")
"""The sum of the given forces of which the model has no channel."""

SETTINGS = ("t", "bound", "tolerance", "rate", "second")
"""What a step reads and does not write: the new row's time, the bounds (J, 1, W), and whether the interval is
the second of a pair.
"""

CARRIED = ("E0", "work", "flow", "K-", "K+", "V-", "V+", "steps")
"""What is carried on from row to row, before the works of the channels; see `LiveKernels`."""

QUADRATURE = ("sum", "apart", "off", "largest", "jumped", "sum before", "apart before")
"""Of each integral with a quadrature error: the integral, its distance from the trapezoidal rule, the error
of the pairs so far, the largest, what was added where a pair was cut short; and the first two a row before.
The integrals are that of P without the works that have no such error, and of the rate of each momentum.
"""

MOMENTA = ("start", "momentum", "impulse", "size", "exchanged", "delta_p", "delta_p_bar")
"""Of each momentum: p at the start and now, ∫ṗ dt, the largest |p|, ∫|ṗ| dt, ΔP and its error bar."""

RESULTS = (
    "delta_c", "error_bar", "energy_exchanged", "change", "limit", "inside", "within", "E", "K", "V"
)  # fmt: skip
"""What a step finds; see `Monitor`. `inside` and `within` are 1 or 0."""


@dataclass(frozen=True)
class Memory:
    """Where rows lie: in a block of so many numbers, q, u and u̇ begin at these places.

    `forces`: of each given channel the places of vectors (nu) with factors; it is the sum of them.
    """

    size: int
    q: int
    u: int
    udot: int
    forces: tuple[tuple[tuple[int, float], ...], ...]


@dataclass(frozen=True)
class Given:
    """What each row brings beside t, q and u.

    `forces`: channels whose force is that of the row's instant; `step_forces`: channels whose force was
    constant over the step that led to the row. `rated`: whether rows bring u̇. `memory`: where they lie; None:
    side by side, q, u, u̇ and the forces.
    """

    forces: tuple[ChannelName, ...] = ()
    step_forces: tuple[ChannelName, ...] = ()
    rated: bool = False
    memory: Memory | None = None

    @property
    def channels(self) -> tuple[ChannelName, ...]:
        """All of them, in the order of a row."""
        return self.forces + self.step_forces

    def place(self, nq: int, nu: int) -> Memory:
        """Where rows lie, with so many coordinates and speeds."""
        if self.memory is not None:
            return self.memory
        first = nq + nu * (2 if self.rated else 1)
        forces = tuple(((first + k * nu, 1.0),) for k in range(len(self.channels)))
        return Memory(first + len(forces) * nu, 0, nq, nq + nu, forces)


@dataclass(frozen=True, eq=False)
class LiveKernels:
    """A step of the balance.

    `step` takes the settings, the integrals of a pair taken as one interval (`skipped`), what is remembered
    and, as its parameters, a new row. It gives what is remembered then: that row and the one before, what
    is `CARRIED`, the `QUADRATURE` and the `MOMENTA`, line by line, and the `RESULTS`. A row is t, q and u
    (the free ones), u̇ if it is given, and the force (nu) of each channel. The sums are, in their order: E at
    the start; the work P of the testing function; ∫|P| dt; least and largest K and V; the number of steps;
    then the work of each of the `channels`, and the potential of each of the `sources`.

    `skipped` gives the integrals with a quadrature error over the last interval and the new one taken as
    one, of the same input; it is None where there is none.

    `driven`: sources whose potential depends on time. `speeds`: those with a momentum testing function.
    """

    inputs: Given
    channels: tuple[ChannelName, ...]
    sources: tuple[ChannelName, ...]
    driven: frozenset[ChannelName]
    speeds: tuple[str, ...]
    step: Kernel
    skipped: Kernel | None


_LIVE_KERNELS: LRUCache[LiveKernels] = LRUCache(16)


def live_kernels(
    mechanism: Mechanism, rows: Given, testing: tuple[str, ...], start: tuple[float, Array]
) -> LiveKernels:
    """Written out once for a mechanism and what its rows bring; compiled at the first call.

    `testing`: one energy function, and `MOMENTUM` for those of the speeds. `start`: time and free
    coordinates, where the independent constraints are chosen.
    """
    where = (start[0], start[1].tobytes()) if mechanism.constraints else None
    key = (mechanism.digest(), rows, testing, where)
    return _LIVE_KERNELS.get(key, lambda: _written_out(mechanism, rows, testing, start))


def _written_out(
    mechanism: Mechanism, inputs: Given, testing: tuple[str, ...], start: tuple[float, Array]
) -> LiveKernels:
    nu = len(mechanism.speeds)
    motion = equations_of_motion(mechanism)
    channels_of_model = {part.name for part in motion.channels}
    channels_of_model |= {
        ChannelName("prescribed", j.name) for j in mechanism.joints if j.prescribed
    }
    channels_of_model |= {ChannelName("constraint", c.name) for c in mechanism.constraints}
    logged = [name for name in inputs.channels if name in channels_of_model]
    further = [name for name in inputs.channels if name not in channels_of_model]
    logged += [GIVEN] if further else []
    places = {name: slice(k * nu, (k + 1) * nu) for k, name in enumerate(logged)}
    log = LoggedForces(dict.fromkeys(logged, list(range(nu))), places, nu * len(logged))
    symbols = ledger_symbols(mechanism, log, None, start)
    (function,) = testing_functions(testing, constrained=dependent_speeds(motion, *start))
    ledger = ledger_kernels(symbols, (function,), logged, momenta=MOMENTUM in testing)
    momenta = slice(len(ledger.momenta), None)
    s = symbols.system
    speeds = ca.Function("speeds", [s.t, s.q, s.u], [s.u_all])

    # Two rows, and the forces at the ends of the interval between them.
    n = s.u.numel()
    sizes = {"t": 1, "q": s.q.numel(), "u": n, "udot": n if inputs.rated else 0}
    sizes["forces"] = nu * len(inputs.channels)
    before, after = (
        {name: ca.SX.sym(f"{name}{k}", size) for name, size in sizes.items()} for k in (0, 1)
    )
    qdot = ca.Function("qdot", [s.t, s.q, s.u], [s.qdot])
    width = after["t"] - before["t"]

    def forces(row: dict[str, SX], later: dict[str, SX]) -> dict[ChannelName, SX]:
        parts = {}
        for k, name in enumerate(inputs.channels):
            parts[name] = (later if name in inputs.step_forces else row)["forces"][
                k * nu : (k + 1) * nu
            ]
        parts[GIVEN] = sum((parts[name] for name in further), start=ca.SX.zeros(nu))
        return parts

    ends = forces(before, after), forces(after, after)

    # The motion at the nodes, and the powers there.
    column = ca.vertcat(s.q, s.u)
    y = [ca.vertcat(row["q"], row["u"]) for row in (before, after)]
    chord = [(after["u"] - before["u"]) / width] * 2
    rates = [before["udot"], after["udot"]] if inputs.rated else chord
    dy = [
        ca.vertcat(qdot(row["t"], row["q"], row["u"]), rate)
        for row, rate in zip((before, after), rates)
    ]
    size = column.numel()
    between = hermite_kernel(2, size, size, 0, INNER)
    x = ca.vertcat(ca.SX([0.0, 1.0]), width, *y, *dy)
    inner = ca.vertsplit(between.function(x, ca.SX(0, 1)), 2 * size)
    motions = [ca.vertcat(y[0], dy[0]), *inner, ca.vertcat(y[1], dy[1])]
    q, u, v = (slice(0, s.q.numel()), slice(s.q.numel(), size), slice(size + s.q.numel(), None))
    nodes = []
    first, second = ca.SX.zeros(nu), ca.SX.zeros(nu)  # ∫ (1 − x) u dt and ∫ x u dt
    for node, weight, motion in zip(LOBATTO_NODES, LOBATTO_WEIGHTS, motions):
        t = before["t"] + node * width
        given_there = [(1 - node) * ends[0][name] + node * ends[1][name] for name in logged]
        values = {"t": t, "q": motion[q], "u": motion[u], "udot": motion[v]}
        values["logged"] = ca.vertcat(ca.SX(0, 1), *given_there)
        nodes.append(_evaluated(ledger.between, values))
        moved = weight * width * speeds(t, motion[q], motion[u])
        first, second = first + (1 - node) * moved, second + node * moved
    powers = {name: [parts[name] for parts in nodes] for name in ("channels", "functions")}
    powers["impulses"] = [ca.densify(parts["force"][momenta, :]) for parts in nodes]
    sums = {
        name: width * sum(w * p for w, p in zip(LOBATTO_WEIGHTS, at)) for name, at in powers.items()
    }
    powers["sizes"] = [ca.fabs(rate) for rate in powers["impulses"]]
    plain = {name: width * 0.5 * (at[0] + at[-1]) for name, at in powers.items()}

    # The works of this interval; those of held forces have no quadrature error.
    channels = tuple(name for name in ledger.channels if name != GIVEN)
    of_model = dict(zip(ledger.channels, ca.vertsplit(sums["channels"])))
    of_further = {
        name: ca.dot(ends[0][name], first) + ca.dot(ends[1][name], second) for name in further
    }
    works = {**{name: of_model[name] for name in channels}, **of_further}
    steady_channels = [
        name for name in inputs.step_forces if name in works and name not in ledger.potential
    ]
    steady = sum((works[name] for name in steady_channels), start=ca.SX(0))
    mean = width * 0.5 * (speeds(*_state(before)) + speeds(*_state(after)))
    steady_plain = sum((ca.dot(ends[1][name], mean) for name in steady_channels), start=ca.SX(0))
    total, impulse = sums["functions"][0], sums["impulses"]
    steady_force = sum((ends[1][name] for name in steady_channels), start=ca.SX.zeros(nu))
    tested = mechanism.free.u if ledger.speeds else ()
    steady_impulse = width * ca.vertcat(ca.SX(0, 1), *(steady_force[int(k)] for k in tested))
    integrals = ca.vertcat(total - steady, impulse - steady_impulse)
    plain_integrals = ca.vertcat(
        plain["functions"][0] - steady_plain, plain["impulses"] - steady_impulse
    )

    # The energies of the new row, and the sums.
    values = {"t": after["t"], "q": after["q"], "u": after["u"], "udot": rates[1]}
    values["logged"] = ca.vertcat(ca.SX(0, 1), *(ends[1][name] for name in logged))
    row_values = _evaluated(ledger.at_samples, values)
    energies = Energies(*ca.vertsplit(row_values["energies"]))
    E, K, V = function.E(energies), energies.K, energies.V
    potential = ca.densify(row_values["potential"])
    so_far = ca.SX.sym("sums", len(CARRIED) + len(works) + potential.numel())
    old = dict(zip(CARRIED, ca.vertsplit(so_far)[: len(CARRIED)]))
    cumulated = [so_far[len(CARRIED) + k] + work for k, work in enumerate(works.values())]
    lost = ca.vertsplit(potential - so_far[len(CARRIED) + len(works) :])
    flow = sum(map(ca.fabs, [*works.values(), *lost]), start=ca.SX(0))
    new = {
        "E0": old["E0"],
        "work": old["work"] + total,
        "flow": old["flow"] + flow,
        "K-": ca.fmin(old["K-"], K),
        "K+": ca.fmax(old["K+"], K),
        "V-": ca.fmin(old["V-"], V),
        "V+": ca.fmax(old["V+"], V),
        "steps": old["steps"] + 1,
    }
    exchanged = new["flow"] + (new["K+"] - new["K-"]) + (new["V+"] - new["V-"])
    size_of_terms = exchanged + new["K+"] + ca.fmax(ca.fabs(new["V-"]), ca.fabs(new["V+"]))
    rounding = EPS * size_of_terms * (4 + ca.sqrt(new["steps"]))

    # The error of the quadrature, by leaving out every second row; and where a pair was cut short by the
    # trapezoidal rule. As in `balance`, differences are divided by 2^(p/2) − 1, where p is the rule's order.
    settings, results = (
        dict(zip(names, ca.vertsplit(ca.SX.sym(what, len(names)))))
        for what, names in (("settings", SETTINGS), ("results", RESULTS))
    )
    skipped = ca.SX.sym("skipped", integrals.numel())
    pair, momentum = (
        {name: ca.SX.sym(name, size) for name in names}
        for names, size in ((QUADRATURE, integrals.numel()), (MOMENTA, impulse.numel()))
    )
    summed = pair["sum"] + integrals
    offset = pair["off"] + summed - pair["sum before"] - skipped
    paired = {
        "sum": summed,
        "apart": pair["apart"] + ca.fabs(integrals - plain_integrals),
        "off": ca.if_else(settings["second"], offset, pair["off"]),
        "largest": ca.fmax(pair["largest"], ca.if_else(settings["second"], ca.fabs(offset), 0.0)),
        "jumped": pair["jumped"],
        "sum before": pair["sum"],
        "apart before": pair["apart"],
    }
    smooth = inputs.rated and not inputs.forces  # these are interpolated linearly
    factor = 1.0 / (2.0 ** ((HERMITE_ORDERS[2] if smooth else 2) / 2) - 1.0)
    exact = ca.simplify(integrals[0]).is_zero()
    uncertain = ca.vertcat(0.0 if exact else 1.0, ca.SX.ones(impulse.numel()))
    quadrature = uncertain * (factor * paired["largest"] + paired["jumped"])

    # The momenta.
    p_now = ca.densify(row_values["momentum"][momenta, :])
    flowed = momentum["impulse"] + impulse
    size = ca.fmax(momentum["size"], ca.fabs(p_now))
    scale = size + momentum["exchanged"] + plain["sizes"]
    moved_by = {
        "start": momentum["start"],
        "momentum": p_now,
        "impulse": flowed,
        "size": size,
        "exchanged": momentum["exchanged"] + plain["sizes"],
        "delta_p": p_now - momentum["start"] - flowed,
        "delta_p_bar": quadrature[1:, :] + EPS * scale * (4 + ca.sqrt(new["steps"])),
    }

    # Whether the row is within the bounds, written so that NaN is outside.
    delta_c = E - new["E0"] - new["work"]
    bar = rounding + quadrature[0]
    change = delta_c - results["delta_c"]
    reference_energy = new["K+"] + new["V+"] - new["V-"]
    limit = settings["bound"] + settings["tolerance"] * reference_energy
    inside = ca.fabs(delta_c) - bar <= limit
    allowed = ca.fmax(settings["rate"] * width + bar - results["error_bar"], bar)
    within = ca.logic_and(inside, ca.fabs(change) <= allowed)
    found_now = (delta_c, bar, exchanged, change, limit, inside, within, E, K, V)

    # In one kernel: of all that is remembered, and of the place where the new row lies.
    place = inputs.place(len(mechanism.coordinates), nu)
    p = ca.SX.sym("p", place.size)
    rows = ca.vertcat(*before.values())
    memory: dict[str, SX] = {
        "settings": ca.vertcat(*settings.values()),
        "skipped": skipped,
        "row": rows,
        "before": ca.SX.sym("before", rows.numel()),
        "sums": so_far,
        "pair": ca.vertcat(*pair.values()),
        "momenta": ca.vertcat(*momentum.values()),
        "results": ca.vertcat(*results.values()),
    }
    remembered = {
        "row": ca.vertcat(*after.values()),
        "before": rows,
        "sums": ca.vertcat(*new.values(), *cumulated, potential),
        "pair": ca.vertcat(*paired.values()),
        "momenta": ca.vertcat(*moved_by.values()),
        "results": ca.vertcat(*found_now),
    }
    free = mechanism.free
    arriving = {
        "t": settings["t"],
        "q": p[[place.q + int(k) for k in free.q]],
        "u": p[[place.u + int(k) for k in free.u]],
        "udot": p[[place.udot + int(k) for k in free.u]] if inputs.rated else ca.SX(0, 1),
        "forces": ca.vertcat(
            ca.SX(0, 1),
            *(sum(f * p[at : at + nu] for at, f in blocks) for blocks in place.forces),
        ),
    }
    new_row = (ca.vertcat(*after.values()), ca.vertcat(*arriving.values()))
    step = {name: ca.substitute(value, *new_row) for name, value in remembered.items()}
    as_one = None
    if not exact or ledger.speeds:
        two = ca.substitute(ca.substitute(integrals, *new_row), rows, memory["before"])
        as_one = Kernel(memory, {"skipped": ca.densify(two)}, p, name="live, skipped")
    kernel = Kernel(memory, step, p, name="live")
    return LiveKernels(
        inputs, tuple(works), ledger.potential, symbols.driven, ledger.speeds, kernel, as_one
    )


def _state(row: dict[str, SX]) -> tuple[SX, SX, SX]:
    return row["t"], row["q"], row["u"]


def _evaluated(kernel: Kernel, values: dict[str, SX]) -> dict[str, SX]:
    """A kernel of a ledger, of other symbols."""
    x = ca.vertcat(*(values[name] for name in kernel.input_names))
    y = kernel.function(x, ca.SX(0, 1))
    return {name: y[where] for name, where in kernel.output_slices.items()}
