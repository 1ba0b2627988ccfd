"""PNG and PFM by the standard library, and measures over all pixels at once: a mask is an integer
of a byte a pixel."""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}


@dataclass
class Picture:
    """Eight bits a channel; `planes` are red, green, blue and, where there is one, alpha."""

    width: int
    height: int
    planes: list[bytes]

    def above(self, channel: int, value: int) -> int:
        """Pixels whose channel is larger than the value."""
        return int.from_bytes(self.planes[channel].translate(bytes(int(it > value) for it in range(256))), "big")

    def red(self) -> int:
        """As cracks.py tells the plate: red above 150, green and blue below 60."""
        return self.above(0, 150) & ~self.above(1, 59) & ~self.above(2, 59)

    def near(self, mask: int, pixels: int) -> int:
        """The mask and all pixels at most so far from it in x and in y. Sides of the picture wrap,
        as in cracks.py."""
        wide = mask
        for shift in range(1, pixels + 1):
            wide |= (mask << 8 * shift) | (mask >> 8 * shift)
        tall = wide
        for shift in range(1, pixels + 1):
            tall |= (wide << 8 * shift * self.width) | (wide >> 8 * shift * self.width)
        return tall & self.everything()

    def everything(self) -> int:
        return int.from_bytes(b"\x01" * (self.width * self.height), "big")

    def places(self, mask: int) -> bytes:
        """A byte a pixel: 1 in the mask."""
        return mask.to_bytes(self.width * self.height, "big")


def count(mask: int) -> int:
    return mask.bit_count()


def holes(shown: Picture, reference: Picture) -> int:
    """Red here, not red in the reference and not within 3 pixels of its red."""
    return count(shown.red() & ~reference.near(reference.red(), 3))


def mean_difference(a: Picture, b: Picture) -> float:
    """Mean of the absolute differences of red, green and blue, of 255."""
    total = sum(abs(x - y) for channel in range(3) for x, y in zip(a.planes[channel], b.planes[channel]))
    return total / (3 * a.width * a.height)


def contrast(shown: Picture, covered: bytes) -> int:
    """Largest spread of a channel, 10th to 90th percentile of the covered pixels, of 255."""
    spreads = [0]
    for plane in shown.planes[:3]:
        values = sorted(value for value, it in zip(plane, covered) if it)
        if values:
            spreads.append(values[len(values) * 9 // 10] - values[len(values) // 10])
    return max(spreads)


def mean(shown: Picture, covered: bytes) -> float:
    """Mean of red, green and blue over the covered pixels, of 255."""
    total = sum(value for plane in shown.planes[:3] for value, it in zip(plane, covered) if it)
    return total / (3 * max(1, sum(covered)))


def read_png(data: bytes | Path) -> Picture:
    data = data.read_bytes() if isinstance(data, Path) else data
    at, header, body, palette, clear = 8, b"", b"", b"", b""
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        chunk = data[at + 8 : at + 8 + size]
        if kind == b"IHDR":
            header = chunk
        elif kind == b"IDAT":
            body += chunk
        elif kind == b"PLTE":
            palette = chunk
        elif kind == b"tRNS":
            clear = chunk
        at += 12 + size
    width, height, depth, kind, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if depth != 8 or interlaced:
        raise ValueError(f"PNG: expected 8 bits a channel without interlacing, found {depth}, {interlaced}")
    step = CHANNELS[kind]
    pixels = unfiltered(zlib.decompress(body), width * step, height, step)
    planes = [pixels[it::step] for it in range(step)]
    if kind == 3:
        tables = [bytes(palette[it::3]).ljust(256, b"\0") for it in range(3)]
        tables += [clear.ljust(256, b"\xff")] if clear else []
        planes = [planes[0].translate(table) for table in tables]
    elif step < 3:
        planes = [planes[0]] * 3 + planes[1:]
    return Picture(width, height, planes)


def unfiltered(data: bytes, width: int, height: int, step: int) -> bytes:
    rows, above = [], bytes(width)
    for row in range(height):
        start = row * (width + 1)
        kind, line = data[start], bytearray(data[start + 1 : start + 1 + width])
        if kind == 1:
            for it in range(step, width):
                line[it] = (line[it] + line[it - step]) & 255
        elif kind == 2:
            line = bytearray([(a + b) & 255 for a, b in zip(line, above)])
        elif kind == 3:
            for it in range(width):
                left = line[it - step] if it >= step else 0
                line[it] = (line[it] + (left + above[it]) // 2) & 255
        elif kind == 4:
            for it in range(width):
                a, c = (line[it - step], above[it - step]) if it >= step else (0, 0)
                b = above[it]
                pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                line[it] = (line[it] + (a if pa <= pb and pa <= pc else b if pb <= pc else c)) & 255
        above = bytes(line)
        rows.append(above)
    return b"".join(rows)


def png(width: int, height: int, pixels: bytes, channels: int = 3) -> bytes:
    """A file of red, green, blue and, with four channels, alpha."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    row = channels * width
    lines = [pixels[row * it : row * (it + 1)] for it in range(height)]
    # Each byte less the one of the pixel to the left: pictures of smooth shades become small.
    rows = b"".join(b"\1" + line[:channels] + bytes([(a - b) & 255 for a, b in zip(line[channels:], line)]) for line in lines)
    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


@dataclass
class Depths:
    """View-space metres, a row from the top; 0 where nothing was hit."""

    width: int
    height: int
    metres: list[float]

    def covered(self) -> bytes:
        return bytes(int(it > 0) for it in self.metres)


def read_pfm(path: Path) -> Depths:
    kind, size, scale, body = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    values = struct.unpack(f"{'<' if float(scale) < 0 else '>'}{width * height}f", body)
    # Rows go from the bottom to the top.
    rows = [values[width * row : width * (row + 1)] for row in range(height)]
    return Depths(width, height, [it for row in reversed(rows) for it in row])
