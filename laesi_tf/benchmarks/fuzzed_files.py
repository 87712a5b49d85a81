"""Benchmark `fuzz`: damaged and hostile files must neither crash `predict` nor take its time and memory."""

import random
import struct
import tempfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.benchmarks.predict_process import run_predict
from laesi_tf.common.hardware import describe_hardware

MAX_SECONDS = 10.0
"""A single file may take so long."""
MAX_MB = 2000.0
"""`predict` may take so much memory."""
_SUFFIXES = (".jpg", ".png", ".tif", ".heic", ".webp", ".gif", ".bmp", ".avif", ".dng", ".jxl")

Mutation = Callable[[bytes, random.Random], bytes]


def fuzz_predict(photos: Sequence[Path], *, count: int, seed: int) -> dict[str, Any]:
    """Run `predict` on `count` damaged copies of `photos` and hostile files, after one good photo.

    Returns what was found, by name; `is_passed` says whether there was no fault of ours.
    """
    with tempfile.TemporaryDirectory(prefix="laesi-fuzz-") as name:
        folder = Path(name)
        kinds = write_fuzzed_files(photos, folder / "photos", count=count, seed=seed)
        # Results come in the order of names: the time of the first contains that of the start.
        good = folder / "photos" / f"0000{photos[0].suffix}"
        good.write_bytes(photos[0].read_bytes())
        run = run_predict(folder / "photos", folder / "out", ["--workers", "1"])
    has_traceback = "Traceback" in run.messages
    return {
        "files": count,
        "kinds": kinds,
        "seed": seed,
        "exit_status": run.exit_status,
        "has_traceback": has_traceback,
        "longest_file_s": run.longest_photo_s,
        "peak_mb": run.peak_mb,
        "is_passed": run.exit_status == 0
        and not has_traceback
        and run.longest_photo_s <= MAX_SECONDS
        and run.peak_mb <= MAX_MB,
        **describe_hardware(),
    }


def write_fuzzed_files(photos: Sequence[Path], folder: Path, *, count: int, seed: int) -> dict[str, int]:
    """Write `count` files into `folder`; return how many there are of each kind."""
    folder.mkdir(parents=True, exist_ok=True)
    chance, kinds = random.Random(seed), dict.fromkeys(MUTATIONS, 0)
    sources = [(path.suffix, path.read_bytes()) for path in photos if path.stat().st_size]
    for number in range(count):
        suffix, content = chance.choice(sources)
        kind = chance.choice(list(MUTATIONS))
        kinds[kind] += 1
        suffix = chance.choice(_SUFFIXES) if kind == "wrong suffix" or chance.random() < 0.1 else suffix
        (folder / f"{number + 1:04d}{suffix}").write_bytes(MUTATIONS[kind](content, chance))
    return kinds


def format_report(metrics: Mapping[str, Any]) -> str:
    """Format the figures of `fuzz_predict`."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in metrics["kinds"].items())
    return "\n".join(
        [
            f"{metrics['files']} files (seed {metrics['seed']}): {kinds}",
            f"exit status {metrics['exit_status']}, traceback: {metrics['has_traceback']}",
            f"longest file {metrics['longest_file_s']:.1f} s of {MAX_SECONDS:g}, "
            f"peak memory {metrics['peak_mb']:.0f} MB of {MAX_MB:g}",
            "passed" if metrics["is_passed"] else "FAILED",
            "{machine}, {cores} cores, {date}".format_map(metrics),
        ]
    )


def _truncate(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content))]


def _flip_bits(content: bytes, chance: random.Random) -> bytes:
    """Flip bits, most of them in the header, where they do most harm."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 4, 32, 256))):
        end = min(len(changed), chance.choice((64, 1024, len(changed))))
        changed[chance.randrange(end)] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _splice(content: bytes, chance: random.Random) -> bytes:
    """Repeat, remove or overwrite a part."""
    start, length = chance.randrange(len(content)), chance.randrange(1, 4096)
    middle = chance.choice(
        (b"", content[start : start + length] * 3, bytes(length), chance.randbytes(length))
    )
    return content[:start] + middle + content[start + length :]


def _make_bomb(_content: bytes, chance: random.Random) -> bytes:
    """Return a small file that claims a huge image."""
    side = chance.choice((14_000, 30_000, 200_000, 2**31 - 1))
    return chance.choice((_make_png_bomb, _make_tiff_bomb, _make_bmp_bomb, _make_gif_bomb))(side)


def _make_png_bomb(side: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes(10_000_000), 9)
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def _make_tiff_bomb(side: int) -> bytes:
    """Return a TIFF whose only directory claims `side` pixels and follows itself."""
    tags = [
        (256, side),
        (257, side),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, side),
        (279, side),
    ]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + struct.pack("<I", 8)


def _make_bmp_bomb(side: int) -> bytes:
    return (
        b"BM"
        + struct.pack("<IHHI", 1000, 0, 0, 54)
        + struct.pack("<IiiHHIIiiII", 40, side, side, 1, 24, 0, 0, 2835, 2835, 0, 0)
        + bytes(900)
    )


def _make_gif_bomb(side: int) -> bytes:
    size = struct.pack("<HH", min(side, 65535), min(side, 65535))
    return b"GIF89a" + size + b"\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0" + size + b"\0\x02\x02L\x01\0;"


MUTATIONS: dict[str, Mutation] = {
    "truncated": _truncate,
    "bit-flipped": _flip_bits,
    "spliced": _splice,
    "wrong suffix": lambda content, _: content,
    "bomb": _make_bomb,
    "noise": lambda content, chance: chance.randbytes(chance.randrange(1, 5000)),
}
"""How a file is damaged, by the name of the kind."""
