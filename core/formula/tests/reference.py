#!/usr/bin/env python3
"""Reference values for the functions of formulas, by NumPy and SciPy.

Writes reference.json beside this file: series of times (ns) and values (null where not finite), and what each function
gives for them. Run it after a change of the cases: python3 core/formula/tests/reference.py
"""

import json
import pathlib

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import periodogram

rng = np.random.default_rng(7)


def seconds(t):
    return (t - t[0]) * 1e-9 if len(t) else t.astype(float)


def finite_parts(v):
    """Ranges of consecutive finite values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.isfinite(v).astype(int), [0]])))
    return list(zip(edges[::2], edges[1::2]))


def window(t, v, width_s, of):
    half = round(width_s * 0.5e9)
    result = np.full(len(v), np.nan)
    for i in range(len(v)):
        near = v[(t >= t[i] - half) & (t <= t[i] + half)]
        if np.isfinite(v[i]):
            result[i] = of(near[np.isfinite(near)])
    return result


def last_of_each_time(t, v):
    keep = np.append(t[1:] != t[:-1], True) if len(t) else np.zeros(0, bool)
    return t[keep], v[keep]


def derivative(t, v):
    t, v = last_of_each_time(t, v)
    result = np.full(len(v), np.nan)
    for a, b in finite_parts(v):
        if b - a > 1:
            result[a:b] = np.gradient(v[a:b], seconds(t)[a:b])
    return t, result


def integral(t, v):
    if len(v) == 0:
        return v
    s = seconds(t)
    steps = np.where(np.isfinite(v[1:]) & np.isfinite(v[:-1]), np.diff(s) * (v[1:] + v[:-1]) / 2, 0.0)
    result = np.concatenate([[0.0], np.cumsum(steps)])
    if np.isfinite(v).all():
        assert np.allclose(result, cumulative_trapezoid(v, s, initial=0))
    return np.where(np.isfinite(v), result, np.nan)


def spectrum(t, v):
    """One-sided amplitudes with a Hann window, zero-padded to a power of two; frequencies in nHz."""
    ok = np.isfinite(v)
    x, y = last_of_each_time(t[ok], v[ok])
    n = len(x)
    if n < 4:
        return np.zeros(0, np.int64), np.zeros(0)
    s = (x - x[0]).astype(float)
    step = s[-1] / (n - 1)
    even = np.interp(np.arange(n) * step, s, y)
    w = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    m = 1 << (n - 1).bit_length()
    amplitude = np.abs(np.fft.rfft((even - even.mean()) * w, m)) / w.sum()
    amplitude[1 : m // 2] *= 2
    f = np.round(np.arange(m // 2 + 1) / (m * step * 1e-9) * 1e9).astype(np.int64)
    # SciPy's power spectrum has half the square of the amplitude, and no density of its own for both ends.
    power = periodogram(even, 1e9 / step, window="hann", nfft=m, detrend="constant", scaling="spectrum")[1]
    assert np.allclose(amplitude[1:-1], np.sqrt(2 * power[1:-1]))
    return f, amplitude


def interpolated(t, other_t, other_v):
    x, y = last_of_each_time(other_t, other_v)
    if len(x) == 0:
        return np.full(len(t), np.nan)
    return np.interp((t - x[0]).astype(float), (x - x[0]).astype(float), y, left=np.nan, right=np.nan)


def statistics(t, v):
    ok = v[np.isfinite(v)]
    total = integral(t, v)
    total = total[np.isfinite(total)]
    return {
        "points": len(v),
        "finite": len(ok),
        "min": ok.min() if len(ok) else None,
        "max": ok.max() if len(ok) else None,
        "mean": np.nanmean(ok) if len(ok) else None,
        "deviation": np.std(ok) if len(ok) else None,
        "integral": total[-1] if len(total) else 0.0,
    }


def plain(array):
    return [None if not np.isfinite(x) else float(x) for x in array]


def case(name, t, v, other=None):
    t, v = np.asarray(t, np.int64), np.asarray(v, float)
    v = np.where(np.isfinite(v), v, np.nan)
    slope_t, slope = derivative(t, v)
    results = {
        "smooth(/a.v, 0.5)": (t, window(t, v, 0.5, np.mean)),
        "smooth(/a.v)": (t, window(t, v, 1.0, np.mean)),
        "deviation(/a.v, 0.5)": (t, window(t, v, 0.5, np.std)),
        "derivative(/a.v)": (slope_t, slope),
        "integral(/a.v)": (t, integral(t, v)),
        "spectrum(/a.v)": spectrum(t, v),
        "difference(/a.v)": (t, np.diff(v, prepend=np.nan) if len(v) else v),
        "absolute(/a.v)": (t, np.abs(v)),
        "negative(/a.v)": (t, -v),
        "square_root(absolute(/a.v)) + 2 * sine(/a.v)": (t, np.sqrt(np.abs(v)) + 2 * np.sin(v)),
    }
    if other is not None:
        u, w = np.asarray(other[0], np.int64), np.asarray(other[1], float)
        b = interpolated(t, u, w)
        wrapped = np.mod(v - b + np.pi, 2 * np.pi) - np.pi
        results["/a.v - /b.v"] = (t, v - b)
        results["angle_difference(/a.v, /b.v)"] = (t, wrapped)
        results["arc_tangent(/a.v, /b.v)"] = (t, np.arctan2(v, b))
        other = {"t": u.tolist(), "v": plain(w)}
    return {
        "name": name,
        "a": {"t": t.tolist(), "v": plain(v)},
        "b": other,
        "results": {key: {"t": rt.tolist(), "v": plain(rv)} for key, (rt, rv) in results.items()},
        "statistics": statistics(t, v),
    }


def main():
    start = 1_700_000_000_000_000_000
    steps = rng.integers(1, 200_000_000, 40)
    random_t, random_v = start + np.cumsum(steps), rng.normal(0, 3, 40)
    other_t = start + np.cumsum(rng.integers(1, 300_000_000, 30))
    holes = random_v.copy()
    holes[[0, 7, 8, 20, 39]] = np.nan
    holes[12] = np.inf
    alone = np.full(9, np.nan)
    alone[4] = 2.5
    gap_t = np.concatenate([random_t[:15], random_t[15:] + 60_000_000_000])
    again_t = np.sort(start + rng.integers(0, 8, 30) * 250_000_000)
    offset = 4_312_345.0 + rng.normal(0, 0.01, 40)
    cases = [
        case("random", random_t, random_v, (other_t, rng.normal(0, 4, 30))),
        case("empty", [], [], (other_t, rng.normal(0, 4, 30))),
        case("one point", [start], [3.5], ([start], [1.0])),
        case("one point beside", [start], [3.5], ([start + 1], [1.0])),
        case("two points at one time", [start, start], [1.0, 3.0]),
        case("not finite", random_t, holes),
        case("one finite", random_t[:9], alone),
        case("none finite", random_t[:5], np.full(5, np.nan)),
        case("gap", gap_t, random_v, (gap_t[::2], random_v[::2] + 1)),
        case("repeated times", again_t, rng.normal(0, 1, 30), (np.sort(start + rng.integers(0, 9, 20) * 250_000_000), rng.normal(0, 9, 20))),
        case("large offset", random_t, offset),
        case("constant", random_t, np.full(40, 0.1)),
    ]
    path = pathlib.Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(cases, separators=(",", ":")) + "\n")


main()
