"""Compiled loop of the strapdown mechanisation; ``strapdown.integrate_readable`` is its oracle.

Loops are written out and arrays come from the caller: matrix operators and allocations would make
the first call compile for many seconds. A state is ``x`` (13,): attitude quaternion wxyz, velocity
north, east, down, gyro bias, accelerometer bias; and ``place`` (3,): north, east, down (m). On the
curved Earth both are taken to latitude, longitude (rad), height (m) and the NED axes of that place
at the beginning of a span, and back at its end; `local_level` is the oracle of this.
"""

from __future__ import annotations

import math

import numba

from gtsam_nav.frames import EARTH_RATE_RAD_S, STANDARD_GRAVITY_M_S2, Array

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
SECOND_ECCENTRICITY2 = ECCENTRICITY2 / (1 - ECCENTRICITY2)
SEMI_MINOR_M = SEMI_MAJOR_M * (1 - FLATTENING)
MU_M3_S2 = 3.986004418e14
HOLD_S = 1.0
"""The last readings before a silence of the IMU are held this long."""
COAST_STEP_S = 0.1
"""Longest step while the IMU is silent."""
SCRATCH = (40, 15)
"""Shape of the caller's scratch space."""


@numba.njit(cache=True, error_model="numpy")
def integrate(
    x: Array,
    place: Array,
    Phi: Array,
    Q: Array,
    scratch: Array,
    origin: Array,
    t: Array,
    gyro_b: Array,
    accel_b: Array,
    k: int,
    from_s: float,
    to_s: float,
    max_gap_s: float,
    growth: Array,
) -> None:
    """Carry a state, and the transition and noise of its errors, over a span, in place.

    Parameters
    ----------
    Phi, Q : ndarray, shape (15, 15)
        Of the errors (theta_b, rho_b, nu_b, gyro bias, accelerometer bias).
    scratch : ndarray, shape SCRATCH
    origin : ndarray, shape (3,) or (0,)
        Latitude, longitude (rad) and height (m) of the mission's NED; empty on a flat Earth.
    t : ndarray, shape (n,)
        Of the readings ``gyro_b``, ``accel_b`` (n, 3); k is the last one at or before ``from_s``,
        -1 if none.
    max_gap_s : float
        The IMU is silent where its samples lie further apart.
    growth : ndarray, shape (3, 15)
        What the variances of the errors grow by in a second: while the IMU measures, while its last
        readings are held, and while the vehicle coasts.
    """
    A, F, work, vectors = scratch[:9], scratch[9:18], scratch[18:27], scratch[27:]
    curved = len(origin) > 0
    if curved:
        _enter(x, place, origin, vectors)
    now = from_s
    while now < to_s:
        while k + 1 < len(t) and t[k + 1] <= now:
            k += 1
        before = t[k] if k >= 0 else -math.inf
        after = t[k + 1] if k + 1 < len(t) else math.inf
        then = min(after, to_s)
        measured = after - before <= max_gap_s
        held = not measured and now < before + HOLD_S
        if not measured:
            then = min(then, now + COAST_STEP_S)
        if held:
            then = min(then, before + HOLD_S)
        if measured or held:
            for end in range(2):
                share = ((now if end == 0 else then) - before) / (after - before)
                for i in range(3):
                    w, f = gyro_b[k, i], accel_b[k, i]
                    if measured:
                        w += share * (gyro_b[k + 1, i] - w)
                        f += share * (accel_b[k + 1, i] - f)
                    vectors[2 * end, i] = w - x[7 + i]
                    vectors[2 * end + 1, i] = f - x[10 + i]
            _step(x, place, then - now, curved, vectors, F)
        else:
            _coast(x, place, then - now, curved, vectors, F)
        _transition(F, then - now, A)
        _accumulate(A, growth[0 if measured else 1 if held else 2], then - now, Phi, Q, work)
        now = then
    if curved:
        _leave(x, place, origin, vectors)


@numba.njit(cache=True, error_model="numpy")
def _step(x: Array, place: Array, dt: float, curved: bool, vectors: Array, F: Array) -> None:
    """One step on the readings at its two ends; F becomes the errors' rate of change.

    Between the ends the readings are linear in time, which the cross products of coning and
    sculling assume (Titterton and Weston, sections 11.2 and 11.3).
    """
    wa, fa, wb, fb = vectors[0], vectors[1], vectors[2], vectors[3]
    w, f, turn, push, push_n = vectors[4], vectors[5], vectors[6], vectors[7], vectors[8]
    earth, transport, constants = vectors[9], vectors[10], vectors[11]
    v_before, v_mid = vectors[12], vectors[0]
    for i in range(3):
        w[i], f[i] = (wa[i] + wb[i]) / 2, (fa[i] + fb[i]) / 2
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        coning = wa[j] * wb[k] - wa[k] * wb[j]
        sculling = wa[j] * fb[k] - wa[k] * fb[j] - wb[j] * fa[k] + wb[k] * fa[j]
        turn[i] = w[i] * dt + coning * dt * dt / 12
        push[i] = f[i] * dt + ((w[j] * f[k] - w[k] * f[j]) / 2 + sculling / 12) * dt * dt
    _rotate(x, push, push_n)
    for i in range(3):
        v_before[i] = x[4 + i]
        v_mid[i] = x[4 + i] + push_n[i] / 2
    _surroundings(v_mid, place, curved, earth, transport, constants)
    v_mid[2] += constants[2] * dt / 2
    _error_rates(x, w, f, earth, constants, curved, F)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        wj, wk = earth[j] + transport[j], earth[k] + transport[k]
        frame = (wj * push_n[k] - wk * push_n[j]) * dt / 2
        coriolis = (wj + earth[j]) * v_mid[k] - (wk + earth[k]) * v_mid[j]
        x[4 + i] += push_n[i] - frame - coriolis * dt
    x[6] += constants[2] * dt
    for i in range(3):
        transport[i] = -(earth[i] + transport[i]) * dt
    _turn(x, transport, False)
    _turn(x, turn, True)
    _move(x, place, v_before, dt, curved, constants)


@numba.njit(cache=True, error_model="numpy")
def _coast(x: Array, place: Array, dt: float, curved: bool, vectors: Array, F: Array) -> None:
    """One step without readings: the vehicle keeps its velocity and attitude."""
    earth, transport, constants, v = vectors[9], vectors[10], vectors[11], vectors[12]
    for i in range(3):
        v[i] = x[4 + i]
    _surroundings(v, place, curved, earth, transport, constants)
    _move(x, place, v, dt, curved, constants)
    F[:] = 0.0
    for i in range(3):
        F[3 + i, 6 + i] = 1.0


@numba.njit(cache=True, error_model="numpy")
def _surroundings(
    v: Array, place: Array, curved: bool, earth: Array, transport: Array, constants: Array
) -> None:
    """Rates of Earth and of the NED axes (rad/s); radii of motion north and east (m), gravity.

    Groves (2013), equations (2.123), (2.105), (2.106), (5.44), (2.134) and (2.139).
    """
    for i in range(3):
        earth[i] = transport[i] = 0.0
    constants[2] = STANDARD_GRAVITY_M_S2
    if not curved:
        return
    s, c, h = math.sin(place[0]), math.cos(place[0]), place[2]
    w2 = 1 - ECCENTRICITY2 * s * s
    north_m = SEMI_MAJOR_M * (1 - ECCENTRICITY2) / (w2 * math.sqrt(w2)) + h
    east_m = SEMI_MAJOR_M / math.sqrt(w2) + h
    earth[0], earth[2] = EARTH_RATE_RAD_S * c, -EARTH_RATE_RAD_S * s
    transport[0], transport[1] = v[1] / east_m, -v[0] / north_m
    transport[2] = -v[1] * s / (c * east_m)
    surface = 9.7803253359 * (1 + 0.001931853 * s * s) / math.sqrt(w2)
    ratio = EARTH_RATE_RAD_S**2 * SEMI_MAJOR_M**3 * (1 - FLATTENING) / MU_M3_S2
    slope = 2 / SEMI_MAJOR_M * (1 + FLATTENING * (1 - 2 * s * s) + ratio)
    constants[0], constants[1] = north_m, east_m
    constants[2] = surface * (1 - slope * h + 3 * h * h / SEMI_MAJOR_M**2)


@numba.njit(cache=True, error_model="numpy")
def _move(
    x: Array, place: Array, v_before: Array, dt: float, curved: bool, constants: Array
) -> None:
    """Advance the position by the mean of the velocities before and after."""
    n, e = (v_before[0] + x[4]) / 2 * dt, (v_before[1] + x[5]) / 2 * dt
    d = (v_before[2] + x[6]) / 2 * dt
    if curved:
        place[0] += n / constants[0]
        place[1] += e / (constants[1] * math.cos(place[0] - n / constants[0] / 2))
        place[2] -= d
    else:
        place[0], place[1], place[2] = place[0] + n, place[1] + e, place[2] + d


@numba.njit(cache=True, error_model="numpy")
def _error_rates(
    x: Array, w: Array, f: Array, earth: Array, constants: Array, curved: bool, F: Array
) -> None:
    """Rate of change of the errors, first nine rows; see ``strapdown.error_rates``."""
    F[:] = 0.0
    for i in range(3):
        F[i, 9 + i] = -1.0
        F[3 + i, 6 + i] = 1.0
        F[6 + i, 12 + i] = -1.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        e = _matrix(x, 0, i) * earth[0] + _matrix(x, 2, i) * earth[2]
        # -[w]x has +w_i at (j, k) and -w_i at (k, j)
        F[j, k] += w[i]
        F[k, j] -= w[i]
        F[3 + j, 3 + k] += w[i] - e
        F[3 + k, 3 + j] -= w[i] - e
        F[6 + j, 6 + k] += w[i] + e
        F[6 + k, 6 + j] -= w[i] + e
        F[6 + j, k] += f[i]
        F[6 + k, j] -= f[i]
    if not curved:
        return
    for i in range(3):
        for axis in range(3):
            # gravity turns with the horizontal place and weakens with height
            slope = -1 / constants[axis] if axis < 2 else 1 / constants[0] + 1 / constants[1]
            a = _matrix(x, axis, i) * slope * constants[2]
            for j in range(3):
                F[6 + i, 3 + j] += a * _matrix(x, axis, j)


@numba.njit(cache=True, error_model="numpy")
def _transition(F: Array, dt: float, A: Array) -> None:
    """``A := I + F dt + F F dt^2 / 2``, first nine rows; the biases stay."""
    for i in range(9):
        for j in range(15):
            A[i, j] = F[i, j] * dt
        A[i, i] += 1.0
        for k in range(9):
            a = F[i, k] * dt * dt / 2
            if a != 0.0:
                for j in range(15):
                    A[i, j] += a * F[k, j]


@numba.njit(cache=True, error_model="numpy")
def _accumulate(A: Array, growth: Array, dt: float, Phi: Array, Q: Array, work: Array) -> None:
    """``Phi := A Phi`` and ``Q := A Q A' + diag(growth) dt``, in place."""
    for product in range(3):  # A (A Q)' is A Q A', since Q is symmetric
        M = Phi if product == 0 else Q
        for i in range(9):
            for j in range(15):
                work[i, j] = 0.0
            for k in range(15):
                a = A[i, k]
                if a != 0.0:
                    for j in range(15):
                        work[i, j] += a * M[k, j]
        for i in range(9):
            for j in range(15):
                M[i, j] = work[i, j]
        if product > 0:
            for i in range(15):
                for j in range(i):
                    M[i, j], M[j, i] = M[j, i], M[i, j]
    for i in range(15):
        Q[i, i] += growth[i] * dt


@numba.njit(cache=True, error_model="numpy")
def _turn(x: Array, rotation: Array, of_body: bool) -> None:
    """Turn the attitude by a rotation vector in body axes, or in the navigation axes."""
    angle = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2)
    scale = math.sin(angle / 2) / angle if angle > 1e-8 else 0.5
    a, i, j, k = x[0], x[1], x[2], x[3]
    w, p, q, r = math.cos(angle / 2), scale * rotation[0], scale * rotation[1], scale * rotation[2]
    side = 1.0 if of_body else -1.0
    x[0] = a * w - i * p - j * q - k * r
    x[1] = a * p + i * w + side * (j * r - k * q)
    x[2] = a * q + j * w + side * (k * p - i * r)
    x[3] = a * r + k * w + side * (i * q - j * p)
    norm = math.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2)
    for n in range(4):
        x[n] /= norm


@numba.njit(cache=True, error_model="numpy")
def _rotate(x: Array, vector_b: Array, vector_n: Array) -> None:
    for i in range(3):
        vector_n[i] = 0.0
        for j in range(3):
            vector_n[i] += _matrix(x, i, j) * vector_b[j]


@numba.njit(cache=True, error_model="numpy")
def _matrix(x: Array, i: int, j: int) -> float:
    """Entry (i, j) of the rotation matrix of the attitude."""
    if i == j:
        a, b = float(x[1 + (i + 1) % 3]), float(x[1 + (i + 2) % 3])
        return 1 - 2 * (a * a + b * b)
    sign = 1.0 if (j + 1) % 3 == i else -1.0
    entry: float = 2 * (x[1 + i] * x[1 + j] + sign * x[0] * x[1 + 3 - i - j])
    return entry


@numba.njit(cache=True, error_model="numpy")
def _enter(x: Array, place: Array, origin: Array, vectors: Array) -> None:
    """From the mission's NED to latitude, longitude, height and the NED axes of that place."""
    here, there, r_e, step_e = vectors[0], vectors[1], vectors[2], vectors[3]
    _axes(origin, there)
    _to_ecef(origin, r_e)
    _rotate(there, place, step_e)
    for i in range(3):
        r_e[i] += step_e[i]
    _to_geodetic(r_e, place)
    _axes(place, here)
    _change_axes(x, here, there, vectors)


@numba.njit(cache=True, error_model="numpy")
def _leave(x: Array, place: Array, origin: Array, vectors: Array) -> None:
    """The inverse of `_enter`."""
    here, there, r_e, origin_e = vectors[0], vectors[1], vectors[2], vectors[3]
    _axes(place, here)
    _axes(origin, there)
    _to_ecef(place, r_e)
    _to_ecef(origin, origin_e)
    for i in range(3):
        r_e[i] -= origin_e[i]
    for i in range(1, 4):
        there[i] = -there[i]
    _rotate(there, r_e, place)
    for i in range(1, 4):
        there[i] = -there[i]
    _change_axes(x, there, here, vectors)


@numba.njit(cache=True, error_model="numpy")
def _change_axes(x: Array, to: Array, given: Array, vectors: Array) -> None:
    """Express attitude and velocity in other axes; both are quaternions into ECEF."""
    between, v = vectors[4], vectors[5]
    for i in range(4):
        between[i] = to[i] if i == 0 else -to[i]
    _multiply(between, given, between)
    _rotate(between, x[4:7], v)
    for i in range(3):
        x[4 + i] = v[i]
    _multiply(between, x, x)


@numba.njit(cache=True, error_model="numpy")
def _multiply(left: Array, right: Array, out: Array) -> None:
    """Product of two quaternions."""
    a, b, c, d = left[0], left[1], left[2], left[3]
    w, i, j, k = right[0], right[1], right[2], right[3]
    out[0], out[1] = a * w - b * i - c * j - d * k, a * i + b * w + c * k - d * j
    out[2], out[3] = a * j - b * k + c * w + d * i, a * k + b * j - c * i + d * w


@numba.njit(cache=True, error_model="numpy")
def _axes(place: Array, q: Array) -> None:
    """The NED axes of a place in ECEF: Rz(longitude) Ry(-latitude - 90 deg)."""
    a, b = place[1] / 2, -(place[0] + math.pi / 2) / 2
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    q[0], q[1], q[2], q[3] = ca * cb, -sa * sb, ca * sb, sa * cb


@numba.njit(cache=True, error_model="numpy")
def _to_ecef(place: Array, r_e: Array) -> None:
    s, c = math.sin(place[0]), math.cos(place[0])
    normal = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY2 * s * s)
    r_e[0] = (normal + place[2]) * c * math.cos(place[1])
    r_e[1] = (normal + place[2]) * c * math.sin(place[1])
    r_e[2] = ((1 - ECCENTRICITY2) * normal + place[2]) * s


@numba.njit(cache=True, error_model="numpy")
def _to_geodetic(r_e: Array, place: Array) -> None:
    """Bowring's method; two rounds are exact to the nanometre near the surface."""
    axis_m = math.sqrt(r_e[0] * r_e[0] + r_e[1] * r_e[1])
    reduced = math.atan2(r_e[2] * SEMI_MAJOR_M, axis_m * SEMI_MINOR_M)
    for _ in range(2):
        s, c = math.sin(reduced), math.cos(reduced)
        above = r_e[2] + SECOND_ECCENTRICITY2 * SEMI_MINOR_M * s * s * s
        place[0] = math.atan2(above, axis_m - ECCENTRICITY2 * SEMI_MAJOR_M * c * c * c)
        reduced = math.atan2((1 - FLATTENING) * math.sin(place[0]), math.cos(place[0]))
    place[1] = math.atan2(r_e[1], r_e[0])
    s, c = math.sin(place[0]), math.cos(place[0])
    place[2] = axis_m * c + r_e[2] * s - SEMI_MAJOR_M * math.sqrt(1 - ECCENTRICITY2 * s * s)
