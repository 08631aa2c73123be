"""Largest sets of mutually agreeing items: the maximum clique of a graph."""

from __future__ import annotations

from gtsam_nav.series import BoolArray

MOST_BRANCHES = 50_000
"""Of the exact search; then the largest clique found so far stands."""


def largest_clique(adjacent: BoolArray) -> list[int]:
    """Vertices of a maximum clique, in order; the same one for the same graph.

    Branch and bound under a greedy colouring (Tomita and Seki 2003), which starts from the best of
    the greedy cliques that grow from each vertex. Beyond `MOST_BRANCHES` it stops where it is: of
    hundreds of vertices that nearly all agree, the greedy one is then rarely bettered.

    Parameters
    ----------
    adjacent : ndarray of bool, shape (n, n)
        Symmetric; the diagonal does not matter.
    """
    search = _Search(_neighbours(adjacent))
    search.run()
    return _members(search.best)


def _neighbours(adjacent: BoolArray) -> list[int]:
    """Each vertex's neighbours as the bits of an integer."""
    rows = adjacent.copy()
    rows[range(len(rows)), range(len(rows))] = False
    return [sum(1 << j for j in row.nonzero()[0].tolist()) for row in rows]


def _members(vertices: int) -> list[int]:
    return [k for k in range(vertices.bit_length()) if vertices >> k & 1]


class _Search:
    def __init__(self, neighbours: list[int]) -> None:
        self.neighbours = neighbours
        self.best = 0
        self.branches = 0

    def run(self) -> None:
        everyone = (1 << len(self.neighbours)) - 1
        for start, neighbours in enumerate(self.neighbours):
            is_in_best = self.best >> start & 1
            if not is_in_best and neighbours.bit_count() >= self.best.bit_count():
                self._keep(self._grown(start))
        self._expand(*self._without_sure(everyone))

    def _keep(self, clique: int) -> None:
        if clique.bit_count() > self.best.bit_count():
            self.best = clique

    def _grown(self, start: int) -> int:
        """The clique that grows from a vertex by the neighbours that keep most others."""
        clique, left = 1 << start, self.neighbours[start]
        while left:
            count = {k: (self.neighbours[k] & left).bit_count() for k in _members(left)}
            most = max(count.values())
            best = [k for k, kept in count.items() if kept == most]
            # those that are adjacent to all that is left are so to each other
            for k in best if most == len(count) - 1 else best[:1]:
                clique |= 1 << k
                left &= self.neighbours[k]
        return clique

    def _without_sure(self, candidates: int) -> tuple[int, int]:
        """Vertices of any larger clique than the best, and those that may be in one.

        Vertices with too few neighbours are in none; those adjacent to all that are left are.
        """
        sure, before = 0, -1
        while candidates != before:
            before = candidates
            wanted = self.best.bit_count() - sure.bit_count()
            count = {k: (self.neighbours[k] & candidates).bit_count() for k in _members(candidates)}
            for k in [k for k, neighbours in count.items() if neighbours < wanted]:
                candidates &= ~(1 << k)
            for k in _members(candidates):
                if candidates & ~self.neighbours[k] == 1 << k:
                    sure |= 1 << k
                    candidates &= ~(1 << k)
        return sure, candidates

    def _expand(self, clique: int, candidates: int) -> None:
        """Try candidates in falling order of the colour that bounds what they may add."""
        self.branches += 1
        if not candidates:
            self._keep(clique)
            return
        order, bounds = self._coloured(candidates)
        for k, bound in zip(reversed(order), reversed(bounds), strict=True):
            too_few = clique.bit_count() + bound <= self.best.bit_count()
            if too_few or self.branches > MOST_BRANCHES:
                return
            self._expand(clique | 1 << k, candidates & self.neighbours[k])
            candidates &= ~(1 << k)

    def _coloured(self, candidates: int) -> tuple[list[int], list[int]]:
        """Vertices by colour, none adjacent to one of its own; a clique takes one of each."""
        order: list[int] = []
        bounds: list[int] = []
        colour = 0
        while candidates:
            colour += 1
            free = candidates
            while free:
                lowest = free & -free
                k = lowest.bit_length() - 1
                order.append(k)
                bounds.append(colour)
                candidates &= ~lowest
                free &= ~lowest & ~self.neighbours[k]
        return order, bounds
