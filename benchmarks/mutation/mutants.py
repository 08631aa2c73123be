"""Mutants of a module, and a sample of them in which every place has the same chance."""

from __future__ import annotations

import ast
import random
from collections import defaultdict
from collections.abc import Iterator, Sequence
from difflib import unified_diff
from functools import cache
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

from benchmarks.mutation.trials import Mutant

KINDS = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"BitAnd", "BitOr", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
    {"UAdd", "USub"},
)
"""Symbols that replace each other. What floats or arrays refuse at once, such as ``<<`` for ``*``,
would only count how many lines are run."""


def sample(paths: Sequence[Path], size: int, seed: int) -> list[Mutant]:
    """Draw mutants of some modules: first the places, then at each of them one of the changes.

    Drawn in one step, places that can be changed in many ways would count that much more.

    Parameters
    ----------
    paths : sequence of Path
        Modules.
    size : int
        Number of mutants; fewer where there are not so many places.
    seed : int

    Returns
    -------
    list of Mutant
        By file and line.
    """
    draw = random.Random(seed)
    places = [(path, place) for path in sorted(paths) for place in _places(path.read_text())]
    drawn: list[Mutant] = []
    for path, changes in draw.sample(places, len(places)):
        if len(drawn) == size:
            break
        source = path.read_text()
        for operator, occurrence in draw.sample(changes, len(changes)):
            mutated = mutate_code(source, get_operator(operator)(), occurrence)
            if mutated is not None and _acts(source, mutated):
                drawn.append(_mutant(path, operator, source, mutated))
                break
    return sorted(drawn, key=lambda mutant: (mutant.path, mutant.line, mutant.operator))


def _places(source: str) -> Iterator[list[tuple[str, int]]]:
    """Yield for each place in a module the changes to it: operator and occurrence."""
    found = defaultdict(list)
    nodes = list(ast_nodes(get_ast(source)))
    for name, operator in _operators().items():
        positions = (position for node in nodes for position in operator.mutation_positions(node))
        for occurrence, position in enumerate(positions):
            found[position].append((name, occurrence))
    yield from (found[position] for position in sorted(found))


@cache
def _operators() -> dict[str, Operator]:
    """Those that need no arguments and replace like by like."""
    classes = {name: get_operator(name) for name in operator_names()}
    return {
        name: operator()
        for name, operator in classes.items()
        if not operator.arguments() and _like_by_like(name)
    }


def _like_by_like(name: str) -> bool:
    """Whether an operator that exchanges two symbols keeps to one kind."""
    _, _, exchanged = name.partition("Operator_")
    before, _, after = exchanged.partition("_")
    return not after or before == "Delete" or any({before, after} <= kind for kind in KINDS)


def _acts(source: str, mutated: str) -> bool:
    """Whether a mutant is Python at all and differs in what is executed."""
    try:
        changed = ast.parse(mutated)
        compile(changed, "mutant", "exec")
    except SyntaxError:
        return False
    return _executed(changed) != _executed(ast.parse(source))


def _executed(module: ast.Module) -> str:
    return ast.dump(_WithoutHints().visit(module))


class _WithoutHints(ast.NodeTransformer):
    """Drops what only the type checker reads, among it how arguments are to be passed, and numba's
    options: they change no result."""

    def visit_arguments(self, node: ast.arguments) -> ast.AST:
        node.args = [*node.posonlyargs, *node.args, *node.kwonlyargs]
        node.defaults += [default for default in node.kw_defaults if default is not None]
        node.posonlyargs, node.kwonlyargs, node.kw_defaults = [], [], []
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        node.annotation = ast.Name("Any")
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        node.decorator_list = [
            each for each in node.decorator_list if "njit" not in ast.unparse(each)
        ]
        return self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        if "TYPE_CHECKING" in ast.unparse(node.test):
            return None
        return self.generic_visit(node)


def _mutant(path: Path, operator: str, source: str, mutated: str) -> Mutant:
    before, after = source.splitlines(), mutated.splitlines()
    lines = enumerate(zip(before, after, strict=False), start=1)
    line = next((number for number, (old, new) in lines if old != new), len(after))
    changed = list(unified_diff(before, after, n=0, lineterm=""))[3:]
    return Mutant(path, operator.removeprefix("core/"), line, mutated, "\n".join(changed))
