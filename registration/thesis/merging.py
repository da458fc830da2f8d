"""Which segments of neighbouring profiles lie on one surface (sections 4.3.1 and 6.1)."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray
from registration.thesis.segments import Segments
from registration.thesis.view_params import MergeParams


def merge_profiles(segments: Segments, params: MergeParams) -> IntArray:
    """Number the chains of segments that follow one surface from profile to profile.

    Returns (n,) chain of each segment, numbered by the first segment of the chain. The rule is
    params.rule: for "literal" and "global" neighbouring profiles belong together or not as a
    whole, as section 4.3.1 says, for "segments" every segment goes its own way.
    Where profiles are compared as a whole, pairs must hold in the order of the pixels.
    """
    n = len(segments)
    angle = np.arctan2(segments.normal[:, 1], -segments.normal[:, 2])
    ends = np.ascontiguousarray(segments.endpoints_mm[:, :, 1:])
    starts = np.searchsorted(segments.profile, np.arange(segments.profile.max(initial=-1) + 2))
    link = np.full(n, -1, dtype=np.int64)
    rules = {"literal": 0, "global": 1, "segments": 2}
    _link(
        starts.astype(np.int64),
        angle,
        segments.length_mm,
        ends,
        rules[params.rule],
        params.rotation_th_rad,
        params.overlap_th,
        params.close_normal_rad,
        params.jump_mm,
        link,
    )
    chain: IntArray = _number(link)
    return chain


def stretch_shared(segments: Segments, a: int, b: int) -> float:
    """Length in mm of segment a's line that segment b runs beside, at whatever distance."""
    ends = np.ascontiguousarray(segments.endpoints_mm[[a, b], :, 1:])
    return float(run_beside(ends[0], ends[1], np.inf))


@compiled
def _number(link: IntArray) -> IntArray:
    """Chain of every segment, from the segment of the profile before that it continues."""
    chain = np.empty(len(link), dtype=np.int64)
    n = 0
    for s in range(len(link)):
        if link[s] >= 0:
            chain[s] = chain[link[s]]
        else:
            chain[s] = n
            n += 1
    return chain


@compiled
def _link(
    starts: IntArray,
    angle: FloatArray,
    length: FloatArray,
    ends: FloatArray,
    rule: int,
    rotation_th: float,
    overlap_th: float,
    close_normal: float,
    jump: float,
    link: IntArray,
) -> None:
    """Write into link the segment of the profile before that each segment continues, or -1."""
    for k in range(1, len(starts) - 1):
        a, b, c = starts[k - 1], starts[k], starts[k + 1]
        if a == b or b == c:
            continue
        if rule == 0:
            _link_literal(a, b, c, angle, length, rotation_th, overlap_th, link)
        elif rule == 1:
            _link_global(
                a, b, c, angle, length, ends, rotation_th, overlap_th, close_normal, jump, link
            )
        else:
            _link_segments(a, b, c, angle, length, ends, rotation_th, overlap_th, jump, link)


@compiled
def _difference(a: float, b: float) -> float:
    d = a - b
    return float(np.arctan2(np.sin(d), np.cos(d)))


@compiled
def _similar_length(p: float, q: float, overlap_th: float) -> bool:
    return min(p, q) >= (1.0 - overlap_th) * max(p, q)


@compiled
def run_beside(a: FloatArray, b: FloatArray, jump: float) -> float:
    """Length of line a that b runs beside, 0 when b's middle is off it by more than jump.

    a, b: (2, 2) Y and Z of the endpoints.
    """
    dy = a[1, 0] - a[0, 0]
    dz = a[1, 1] - a[0, 1]
    length = np.hypot(dy, dz)
    if length == 0.0:
        return 0.0
    dy /= length
    dz /= length
    middle_y = 0.5 * (b[0, 0] + b[1, 0]) - a[0, 0]
    middle_z = 0.5 * (b[0, 1] + b[1, 1]) - a[0, 1]
    if abs(middle_y * dz - middle_z * dy) > jump:
        return 0.0
    p = (b[0, 0] - a[0, 0]) * dy + (b[0, 1] - a[0, 1]) * dz
    q = (b[1, 0] - a[0, 0]) * dy + (b[1, 1] - a[0, 1]) * dz
    return float(max(0.0, min(length, max(p, q)) - max(0.0, min(p, q))))


@compiled
def _link_literal(
    a: int,
    b: int,
    c: int,
    angle: FloatArray,
    length: FloatArray,
    rotation_th: float,
    overlap_th: float,
    link: IntArray,
) -> None:
    if b - a != c - b:
        return
    for i in range(b - a):
        if abs(_difference(angle[b + i], angle[a + i])) > rotation_th or not _similar_length(
            length[a + i], length[b + i], overlap_th
        ):
            return
    for i in range(b - a):
        link[b + i] = a + i


@compiled
def _link_segments(
    a: int,
    b: int,
    c: int,
    angle: FloatArray,
    length: FloatArray,
    ends: FloatArray,
    rotation_th: float,
    overlap_th: float,
    jump: float,
    link: IntArray,
) -> None:
    """Link the pairs that each prefer the other, by the stretch they share."""
    forward = np.full(b - a, -1, dtype=np.int64)
    backward = np.full(c - b, -1, dtype=np.int64)
    best_forward = np.zeros(b - a)
    best_backward = np.zeros(c - b)
    for i in range(a, b):
        for j in range(b, c):
            shared = run_beside(ends[i], ends[j], jump)
            if (
                shared <= 0.0
                or abs(_difference(angle[i], angle[j])) > rotation_th
                or not _similar_length(length[i], length[j], overlap_th)
            ):
                continue
            if shared > best_forward[i - a]:
                best_forward[i - a] = shared
                forward[i - a] = j
            if shared > best_backward[j - b]:
                best_backward[j - b] = shared
                backward[j - b] = i
    for j in range(b, c):
        i = backward[j - b]
        if i >= 0 and forward[i - a] == j:
            link[j] = i


@compiled
def _link_global(
    a: int,
    b: int,
    c: int,
    angle: FloatArray,
    length: FloatArray,
    ends: FloatArray,
    rotation_th: float,
    overlap_th: float,
    close_normal: float,
    jump: float,
    link: IntArray,
) -> None:
    """Link the best ordered pairing when its overlap is large enough for the whole profile."""
    rows, columns = b - a, c - b
    total = max(length[a:b].sum(), length[b:c].sum())
    best = -1.0
    best_turn = 0.0
    table = np.zeros((rows + 1, columns + 1))
    # The overlap as a function of the common turn can only peak where some pair agrees exactly.
    for q in range(-1, rows * columns):
        turn = 0.0
        if q >= 0:
            turn = _difference(angle[b + q % columns], angle[a + q // columns])
            if abs(turn) > rotation_th:
                continue
        overlap = _align(a, b, c, angle, length, ends, turn, close_normal, jump, table)
        if overlap > best or (overlap == best and abs(turn) < abs(best_turn)):
            best = overlap
            best_turn = turn
    if best < (1.0 - overlap_th) * total:
        return
    _align(a, b, c, angle, length, ends, best_turn, close_normal, jump, table)
    i, j = rows, columns
    while i > 0 and j > 0:
        if table[i, j] == table[i - 1, j]:
            i -= 1
        elif table[i, j] == table[i, j - 1]:
            j -= 1
        else:
            i -= 1
            j -= 1
            link[b + j] = a + i


@compiled
def _align(
    a: int,
    b: int,
    c: int,
    angle: FloatArray,
    length: FloatArray,
    ends: FloatArray,
    turn: float,
    close_normal: float,
    jump: float,
    table: FloatArray,
) -> float:
    """Largest overlap (4-5) of pairs in the order of the pixels, by dynamic programming."""
    for i in range(b - a):
        for j in range(c - b):
            value = max(table[i, j + 1], table[i + 1, j])
            p, q = a + i, b + j
            if (
                run_beside(ends[p], ends[q], jump) > 0.0
                and abs(_difference(angle[q], angle[p] + turn)) <= close_normal
            ):
                value = max(value, table[i, j] + min(length[p], length[q]))
            table[i + 1, j + 1] = value
    return float(table[b - a, c - b])
