"""A histogram as SVG, for pages that need no other file."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_WIDTH, _HEIGHT = 760, 220
_LEFT, _RIGHT, _TOP, _BOTTOM = 48, 12, 12, 40
_MAX_BINS = 40


def draw_histogram(areas: Sequence[float]) -> str:
    """Return an SVG element with the distribution of `areas` in cm2."""
    edges = choose_edges(areas)
    counts, _ = np.histogram(areas, edges)
    most, bars = int(counts.max()), []
    width, height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    span = edges[-1] - edges[0]
    for count, low, high in zip(counts, edges[:-1], edges[1:], strict=True):
        x, right = (_LEFT + width * (edge - edges[0]) / span for edge in (low, high))
        tall = height * count / most
        bars.append(
            f'<rect x="{x + 0.5:.1f}" y="{_TOP + height - tall:.1f}" width="{max(0.5, right - x - 1):.1f}" '
            f'height="{tall:.1f}" fill="#3b7d4f"><title>{low:.4g} to {high:.4g} cm²: {count}</title></rect>'
        )
    step = max(1, math.ceil((len(edges) - 1) / 8))
    base = _TOP + height
    labels = [
        f'<text x="{_LEFT + width * (edge - edges[0]) / span:.1f}" y="{base + 18}" text-anchor="middle">'
        f"{edge:.4g}</text>"
        for edge in edges[::step]
    ]
    labels += [
        f'<text x="{_LEFT - 8}" y="{_TOP + 10}" text-anchor="end">{most}</text>',
        f'<text x="{_LEFT - 8}" y="{base}" text-anchor="end">0</text>',
        f'<text x="{_LEFT + width / 2}" y="{_HEIGHT - 4}" text-anchor="middle">area of a leaf, cm²</text>',
        f'<path d="M{_LEFT} {base}H{_LEFT + width}" stroke="#889"/>',
    ]
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" role="img" '
        'aria-label="histogram of the areas" font-family="system-ui, sans-serif" font-size="13" fill="#445">'
        f"{''.join(bars)}{''.join(labels)}</svg>"
    )


def choose_edges(values: Sequence[float]) -> NDArray[np.float64]:
    """Return round edges of 1 to 40 bins that hold all `values`."""
    low, high = min(values), max(values)
    wanted = min(_MAX_BINS // 2, max(5, math.isqrt(len(values))))
    raw = (high - low or abs(high) or 1.0) / wanted
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw * 0.999)
    first, last = math.floor(low / step), math.floor(high / step) + 1
    return np.arange(first, last + 1, dtype=np.float64) * step
