"""What the steps of an ensemble would ask of a processor: instructions, and bytes to and from memory.

`python benchmarks/roofline.py`. Counted on the straight-line code that deltac compiles, for a machine whose
threads hold so many numbers in registers: each member is a thread, a number that is needed again and has no
register goes to memory and back (the one needed last goes first; Belady, IBM Syst. J. 5, 1966). Both are
bounds from below: loads of constants, addresses and the libraries' functions come on top.
"""

from __future__ import annotations

import argparse
import heapq
from typing import Any

import casadi as ca
import ensemble_run

from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from deltac.simulation.stepping.explicit import FUSED_INSTRUCTIONS, FixedMethod

TESTING = ("wang", "liu-huston")


def counted(function: Any, registers: int) -> dict[str, int]:
    """Arithmetic instructions of a CasADi function, inputs and outputs, and numbers spilled and reloaded."""
    code: list[tuple[int, list[int]]] = []  # the value written, those read
    arithmetic = inputs = outputs = 0
    latest: dict[int, int] = {}  # place in the work vector -> the value there
    constants: set[int] = set()
    for k in range(function.n_instructions()):
        op, reads, writes = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if op == ca.OP_OUTPUT:
            outputs += 1
            code.append((-1, [latest[reads[0]]]))
            continue
        if op == ca.OP_CONST:
            constants.add(k)
        elif op == ca.OP_INPUT:
            inputs += 1
            code.append((k, []))
        else:
            arithmetic += 1
            code.append((k, [latest[r] for r in dict.fromkeys(reads)]))
        latest[writes[0]] = k
    uses: dict[int, list[int]] = {}
    for at in reversed(range(len(code))):
        for value in code[at][1]:
            uses.setdefault(value, []).append(at)  # the next use is the last of the list
    held: set[int] = set()
    saved: set[int] = set()
    furthest: list[tuple[int, int]] = []  # (−next use, value), with entries that are out of date
    stores = loads = 0

    def keep(value: int) -> None:
        nonlocal stores
        held.add(value)
        heapq.heappush(furthest, (-uses[value][-1], value))
        while len(held) > registers:
            due, other = heapq.heappop(furthest)
            if other in held and uses[other] and uses[other][-1] == -due:
                held.discard(other)
                if other not in saved:
                    saved.add(other)
                    stores += 1

    for value, reads in code:
        for read in (r for r in reads if r not in constants):
            loads += read not in held
            uses[read].pop()
            held.discard(read)
            if uses[read]:
                keep(read)
        if value >= 0 and uses.get(value):
            keep(value)
    return {
        "instructions": arithmetic,
        "inputs": inputs,
        "outputs": outputs,
        "stores": stores,
        "loads": loads,
    }


def steps(registers: int) -> dict[str, dict[str, int]]:
    """A step of ode4 with two testing functions: of the triple pendulum in one, of the humanoid by stages."""
    found = {}
    for race in (ensemble_run._pendulum(8), ensemble_run._humanoid(8)):
        method = FixedMethod(build_flow(race.mechanism, TESTING), find_solver("ode4"))
        if method.instructions <= FUSED_INSTRUCTIONS:
            found[race.name] = counted(method.single_step, registers)
        else:
            x = method.flow.x.shape[0]
            stage = counted(method.flow.rate, registers)
            # Beside ẋ: x, the slopes so far, and the sums between the stages.
            found[race.name] = {name: 4 * n for name, n in stage.items()}
            found[race.name]["instructions"] += 2 * (6 + 4) * x
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--registers", type=int, default=127, help="doubles that a thread holds")
    given = parser.parse_args()
    for name, one in steps(given.registers).items():
        moved = 8 * (one["stores"] + one["loads"])
        state = 8 * (one["inputs"] + one["outputs"])
        print(
            f"{name}: {one['instructions']} instructions a step; {state} bytes of states, {moved} spilled; "
            f"{one['instructions'] / (state + moved):.2f} instructions a byte, "
            f"{one['instructions'] / state:.2f} if nothing were spilled"
        )
