"""Small ICC profiles, made from their definitions, as phones, cameras and scanners embed them."""

import struct

import numpy as np
from numpy.typing import NDArray

SRGB_PRIMARIES = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
P3_PRIMARIES = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
ADOBE_PRIMARIES = ((0.640, 0.330), (0.210, 0.710), (0.150, 0.060))
_D65, _D50 = (0.3127, 0.3290), (0.3457, 0.3585)
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

ADOBE_GAMMA = 563 / 256


def rgb_profile(primaries: tuple[tuple[float, float], ...], *, gamma: float | None) -> bytes:
    """Return a profile of the `primaries`, white D65, with a gamma or, for None, with sRGB's curve."""
    curve = _srgb_curve() if gamma is None else _gamma_curve(gamma)
    columns = _to_xyz(primaries).T
    tags = {f"{name}XYZ": _xyz(column) for name, column in zip("rgb", columns, strict=True)}
    return _profile("RGB ", tags | {f"{name}TRC": curve for name in "rgb"})


def grey_profile(gamma: float) -> bytes:
    """Return a profile of grey with a gamma."""
    return _profile("GRAY", {"kTRC": _gamma_curve(gamma)})


def cmyk_profile(lab: NDArray[np.float64]) -> bytes:
    """Return a profile of CMYK that interpolates `lab` [2, 2, 2, 2, 3], the colours of no and full inks."""
    ramp = bytes(range(256))
    scaled = lab * [255 / 100, 1, 1] + [0, 128, 128]
    lut = b"mft1" + bytes(4) + bytes([4, 3, 2, 0]) + struct.pack(">9i", *(np.eye(3, dtype=int) << 16).ravel())
    lut += ramp * 4 + np.clip(np.round(scaled), 0, 255).astype(np.uint8).tobytes() + ramp * 3
    return _profile("CMYK", {"A2B0": lut, "A2B1": lut}, connection="Lab ", kind="prtr")


def encode(
    image: NDArray[np.uint8], primaries: tuple[tuple[float, float], ...], gamma: float | None
) -> NDArray:
    """Return the sRGB `image` [H, W, 3] in the colours of another profile."""
    value = image / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    mixed = linear @ (np.linalg.inv(_to_xyz(primaries)) @ _to_xyz(SRGB_PRIMARIES)).T
    mixed = np.clip(mixed, 0, 1)
    srgb = np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055)
    return np.round(255 * (srgb if gamma is None else mixed ** (1 / gamma))).astype(np.uint8)


def _to_xyz(primaries: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """Return the matrix from linear RGB to XYZ, adapted from D65 to the D50 of profiles."""
    matrix = np.array([_xyz_of(point) for point in primaries]).T
    matrix = matrix * np.linalg.solve(matrix, _xyz_of(_D65))
    scale = (_BRADFORD @ _xyz_of(_D50)) / (_BRADFORD @ _xyz_of(_D65))
    return np.linalg.inv(_BRADFORD) @ np.diag(scale) @ _BRADFORD @ matrix


def _xyz_of(point: tuple[float, float]) -> NDArray[np.float64]:
    x, y = point
    return np.array([x / y, 1, (1 - x - y) / y])


def _fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))


def _xyz(values: NDArray[np.float64]) -> bytes:
    return b"XYZ " + bytes(4) + _fixed(*values)


def _gamma_curve(gamma: float) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)


def _srgb_curve() -> bytes:
    return (
        b"para"
        + bytes(4)
        + struct.pack(">HH", 3, 0)
        + _fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
    )


def _profile(space: str, tags: dict[str, bytes], *, connection: str = "XYZ ", kind: str = "mntr") -> bytes:
    """Return an ICC profile, version 4, of the colour `space` with the given `tags`."""
    text = "test".encode("utf-16-be")
    name = b"mluc" + bytes(4) + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(text), 28) + text
    tags = {"desc": name, "cprt": name, "wtpt": _xyz(_xyz_of(_D50)), **tags}
    table, data = struct.pack(">I", len(tags)), b""
    start = 128 + 4 + 12 * len(tags)
    for tag, content in tags.items():
        table += struct.pack(">4sII", tag.encode(), start + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    header = struct.pack(">I4sI4s4s4s", 128 + len(table) + len(data), bytes(4), 0x04200000, kind.encode(),
                         space.encode(), connection.encode())  # fmt: skip
    header += struct.pack(">6H4s", 2026, 1, 1, 0, 0, 0, b"acsp") + bytes(28) + _fixed(*_xyz_of(_D50))
    return header.ljust(128, b"\0") + table + data
