"""Compare the active-set method of the law `allocation` with two QP libraries on QPs of a stop.

The libraries are not part of the project: ``./omni exec python -m pip install quadprog daqp``.
"""

import copy
from collections.abc import Callable
from functools import partial
from typing import Any

import daqp
import numpy as np
import output
import quadprog

from omni_brake_assist.laws import allocation, law
from omni_brake_assist.laws.box_least_squares import Box, box_least_squares
from omni_core.kernels import lean
from omni_runs import compiled

problems: list[Box] = []  # copies of the solved QPs of the stop


class Recorded:
    """Runs the law `allocation`, and appends each QP with its solution to `problems`."""

    def __init__(self, *made_of: Any) -> None:
        self._constants = allocation.make_constants(*made_of)
        self._memory = allocation.new_memory(self._constants)

    def step(self, *arguments: Any) -> int:
        """Compute the enables as `allocation` does, and store the QP."""
        answer = int(allocation.step(self._constants, self._memory, *arguments))
        if answer == law.ASSIST:
            problems.append(copy.deepcopy(self._memory.qp))
        return answer


@lean
def solve_often(box: Box, start: Any, times: int) -> None:
    for _ in range(times):
        for i in range(start.size):
            box.solution[i] = start[i]
        box_least_squares(box)


def dense(box: Box) -> tuple[Any, ...]:
    """Return the Hessian, the gradient at the origin and the upper bounds of a QP."""
    weighted = box.rows.T * box.weights
    h, f = weighted @ box.rows + np.diag(box.damping), box.linear - weighted @ box.goals
    return h, f, np.nan_to_num(box.upper, posinf=1e3)  # quadprog accepts no infinite bound


def main() -> None:
    options = output.options(__doc__, repeats=5)
    compiled.own_law = Recorded  # type: ignore[assignment, attr-defined]
    compiled.run_fast_loop(output.load("straight_line", "allocation", "feedback=velocity_sensor"))
    m = problems[0].solution.size
    both, none, low = np.hstack((np.eye(m), -np.eye(m))), np.zeros((0, m)), np.zeros(m)
    solvers: dict[str, Callable[[Any, Any, Any], Any]] = {
        "quadprog": lambda h, f, u: quadprog.solve_qp(h, -f, both, np.append(low, -u))[0],
        "daqp": lambda h, f, u: daqp.solve(h, f, none, u, low)[0],
    }
    spent = dict.fromkeys(("own_compiled", "own", *solvers), 0.0)
    worst = dict.fromkeys(solvers, 0.0)
    for box, before in zip(problems[1:], problems, strict=False):
        h, f, u = dense(box)
        least = 0.5 * box.solution @ h @ box.solution + f @ box.solution
        for name, solve in solvers.items():
            x = solve(h, f, u)
            spent[name] += output.fastest(partial(solve, h, f, u), options.repeats)
            worst[name] = max(worst[name], abs(0.5 * x @ h @ x + f @ x - least))
        for name, times in (("own", 1), ("own_compiled", 1000)):
            own = partial(solve_often, box, before.solution, times)
            spent[name] += output.fastest(own, options.repeats) / times
    metrics: output.Metrics = {
        f"cpu_time.{name}": (1e6 * time / (len(problems) - 1), "us") for name, time in spent.items()
    }
    metrics |= {f"cost_difference.{name}": (value, "1") for name, value in worst.items()}
    output.publish("qp_solvers", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
