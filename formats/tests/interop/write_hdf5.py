"""Writes events in every kind of HDF5 file that is read: `write_hdf5.py FOLDER` prints a line `file events sha256 options`."""

import hashlib
import json
import os
import sys

import h5py
import hdf5plugin
import numpy as np

folder = sys.argv[1]
COUNT = 30_000
generator = np.random.default_rng(7)
t = np.sort(generator.integers(0, 3_000_000, COUNT)) + 5_000_000_000
t[1000] -= 400
x = generator.integers(0, 346, COUNT)
y = generator.integers(0, 260, COUNT)
p = generator.integers(0, 2, COUNT)
DIGEST = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])


def done(name, t=t, kept=slice(None), **options):
    events = np.empty(COUNT, DIGEST)
    for column, values in zip("txyp", (t, x, y, p)):
        events[column] = values
    events = events[kept]
    print(json.dumps([name, len(events), hashlib.sha256(events.tobytes()).hexdigest(), options]))


def columns(name, dtypes=("i8", "u2", "u2", "u1"), t=t, file_options={}, polarities=None, names="txyp", **kind):
    with h5py.File(os.path.join(folder, name), "w", **file_options) as file:
        group = file.create_group("events")
        values = (t, x, y, p if polarities is None else polarities)
        for column, values, dtype in zip(names, values, dtypes):
            group.create_dataset(column, data=values.astype(dtype), **kind)


filters = {
    "gzip": dict(compression="gzip"),
    "gzip-shuffle-fletcher": dict(compression="gzip", shuffle=True, fletcher32=True),
    "fletcher": dict(fletcher32=True),
    "lzf": dict(compression="lzf"),
    "lzf-shuffle": dict(compression="lzf", shuffle=True),
    "lz4": dict(hdf5plugin.LZ4()),
    "lz4-small": dict(hdf5plugin.LZ4(nbytes=1000)),
    "zstd": dict(hdf5plugin.Zstd()),
    "plain": dict(),
}
for codec in ("blosclz", "lz4", "lz4hc", "zlib", "zstd"):
    for shuffle in (0, 1, 2):
        for level in (0, 1, 9):
            filters[f"blosc-{codec}-{shuffle}-{level}"] = dict(hdf5plugin.Blosc(codec, level, shuffle))
for name, kind in filters.items():
    for rows in (1000, 4096, 30_001 if name == "plain" else 29_999):
        chunks = (min(rows, COUNT),)
        columns(f"{name}-{rows}.h5", chunks=chunks, **kind)
        done(f"{name}-{rows}.h5")

# Every index of chunks, old and new.
for version in ("earliest", "v108", "v110", "v114", "latest"):
    for grows in (None, (None,)):
        for rows in (7, 100, 5000, COUNT):
            for kind in (dict(), dict(compression="gzip")):
                name = f"index-{version}-{bool(grows)}-{rows}-{bool(kind)}.h5"
                columns(name, file_options=dict(libver=version), maxshape=grows, chunks=(rows,), **kind)
                done(name)
    columns(f"contiguous-{version}.h5", file_options=dict(libver=version))
    done(f"contiguous-{version}.h5")

# Types of numbers.
small = t - t.min()
for name, dtypes in {
    "big-endian": (">i8", ">u2", ">u2", "u1"),
    "signed": ("u8", "i2", "i4", "i1"),
    "wide": ("i8", "u4", "i8", "i8"),
    "widest": ("u8", "u8", "u4", "u4"),
    "bool": ("i8", "u2", "u2", "?"),
    "floats": ("i8", "f4", "f8", "f4"),
}.items():
    columns(f"{name}.h5", dtypes)
    done(f"{name}.h5")
columns("narrow.h5", ("u4", "u2", "u2", "i2"), t=small)
done("narrow.h5", t=small)
columns("minus-one.h5", ("i8", "u2", "u2", "i1"), polarities=2 * p - 1)
done("minus-one.h5")

# What is on no sensor is dropped and counted, never wrapped.
with h5py.File(os.path.join(folder, "off-sensor.h5"), "w") as file:
    wide = x.astype("i4")
    wide[17], wide[18], wide[19] = 70_000, -1, 65_536
    for column, values in zip("txyp", (t, wide, y, p)):
        file.create_dataset(f"events/{column}", data=values)
done("off-sensor.h5", kept=np.delete(np.arange(COUNT), [17, 18, 19]))

# Units of time.
for unit, scale in {"s": 1_000_000, "ms": 1000, "us": 1, "ns": 0.001}.items():
    columns(f"float-{unit}.h5", ("f8", "u2", "u2", "u1"), t=small / scale)
    done(f"float-{unit}.h5", t=small, time_unit=unit)
columns("int-ns.h5", t=small * 1000)
done("int-ns.h5", t=small, time_unit="ns")
columns("seconds.h5", ("f8", "i2", "i2", "?"), t=small / 1e6, names=("ts", "xs", "ys", "ps"))
done("seconds.h5", t=small)

# Triggers, which come before the first event that is not earlier: before all events, among them, around the step back,
# in no order, at the same time, after all.
edges = np.zeros(300, [("p", "i2"), ("t", "i8"), ("id", "i2")])
edges["t"][:200] = np.linspace(t.min() - 50_000, t.max() + 50_000, 200)
edges["t"][200:] = t[15_000]
edges["t"][40:43] = t[999] - 200, t[999], t[1001]
edges["t"][70:72] = edges["t"][71], edges["t"][70]
edges["t"][80:90] = t[12_345]
edges["p"][::2] = 1
edges["id"] = np.arange(300) % 7
places = np.searchsorted(np.maximum.accumulate(t), np.maximum.accumulate(edges["t"]))
triggers = " ".join(f"{edge['t']},{place},{edge['id']},{edge['p']}" for edge, place in zip(edges, places))

# Prophesee's compound, also without the gap before t; a group with many names and attributes.
for name, offsets in {"compound": [0, 2, 4, 8], "compound-packed": [0, 2, 4, 6]}.items():
    kind = np.dtype(
        {"names": list("xypt"), "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": offsets, "itemsize": offsets[-1] + 8}
    )
    events = np.zeros(COUNT, kind)
    for column, values in zip("txyp", (t, x, y, p)):
        events[column] = values
    for version in ("earliest", "latest"):
        with h5py.File(os.path.join(folder, f"{name}-{version}.h5"), "w", libver=version) as file:
            file.attrs["geometry"] = "346x260"
            for i in range(40):
                file.attrs[f"attribute {i}"] = i
                file.create_group(f"group {i}")
            file.create_dataset("CD/events", data=events, chunks=(2500,), compression="gzip")
            file.create_dataset("EXT_TRIGGER/events", data=edges, chunks=(128,), compression="gzip")
        done(f"{name}-{version}.h5", triggers=triggers)



def runs(values, longest, word):
    """Runs of equal values as words of `value << bits | length`; longer ones say so and have a second word."""
    out = b""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    for start, end in zip(starts[:-1], starts[1:]):
        length, value = int(end - start), int(values[start]) * (longest + 1)
        out += (value + min(length, longest)).to_bytes(word, "little")
        if length >= longest:
            out += length.to_bytes(2, "little")
    return out


def ecf(t, x, y, p, mode):
    """A chunk in Prophesee's codec: mode 0 has runs and masks, 1 packs x and p, 2 packs y, x and p."""
    out = (len(t) << 2 | mode).to_bytes(4, "little") + int(t[0]).to_bytes(8, "little")
    now = int(t[0])
    starts = np.concatenate([[0], np.flatnonzero(np.diff(t)) + 1, [len(t)]])
    for start, end in zip(starts[:-1], starts[1:]):
        step, length = max(int(t[start]) - now, 0), int(end - start)
        now += step
        if step >= 15:
            while step:
                out += bytes([0xF0 | step & 15])
                step >>= 4
        out += bytes([step << 4 | min(length, 15)])
        if length >= 15:
            out += length.to_bytes(2, "little")
    pad = lambda values: np.concatenate([values, np.zeros(-len(values) % 4, int)]).reshape(-1, 4)
    four = [(int(a), int(b), int(c), int(d)) for a, b, c, d in pad((y << 12 if mode == 2 else 0) | x << 1 | p)]
    if mode == 2:
        for a, b, c, d in four:
            words = (a << 8 | b & 0xFF, (b >> 8) << 16 | c & 0xFFFF, (c >> 16) << 24 | d)
            out += b"".join(word.to_bytes(4, "little") for word in words)
        return out
    out += runs(y, 31, 2)
    if mode == 1:
        for a, b, c, d in four:
            words = (a << 4 | b & 0xF, (b >> 4) << 8 | c & 0xFF, (c >> 8) << 12 | d)
            out += b"".join(word.to_bytes(2, "little") for word in words)
        return out
    i = 0
    while i < len(x):
        first, mask = int(x[i]), 0
        i += 1
        for next in range(5):
            if i < len(x) and x[i] == first + next + 1:
                mask |= 16 >> next
                i += 1
        out += (first << 5 | mask).to_bytes(2, "little")
    return out + runs(p, 127, 1)


# Prophesee's own files; its codec cannot tell steps back, and keeps runs.
rising = np.maximum.accumulate(t)
for mode in (0, 1, 2):
    kind = {"names": list("xypt"), "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8], "itemsize": 16}
    with h5py.File(os.path.join(folder, f"ecf-{mode}.h5"), "w") as file:
        file.attrs["geometry"] = "346x260"
        options = dict(chunks=(10_000,), compression=0x8ECF, allow_unknown_filter=True)
        data = file.create_dataset("CD/events", (COUNT,), np.dtype(kind), **options)
        for start in range(0, COUNT, 10_000):
            part = slice(start, start + 10_000)
            data.id.write_direct_chunk((start,), ecf(rising[part], x[part], y[part], p[part], mode))
    done(f"ecf-{mode}.h5", t=rising)
# With runs of all lengths.
x_runs, y_runs, p_runs = np.arange(COUNT) % 340, np.arange(COUNT) // 37 % 260, np.arange(COUNT) // 200 % 2
y_runs[:5000] = np.arange(5000) // 20
t_runs = 5_000_000_000 + np.arange(COUNT) // 18 * 7 + np.arange(COUNT) // 3000 * 100_000
x, y, p = x_runs, y_runs, p_runs
with h5py.File(os.path.join(folder, "ecf-runs.h5"), "w") as file:
    data = file.create_dataset("CD/events", (COUNT,), np.dtype(kind), **options)
    for start in range(0, COUNT, 10_000):
        part = slice(start, start + 10_000)
        data.id.write_direct_chunk((start,), ecf(t_runs[part], x[part], y[part], p[part], 0))
done("ecf-runs.h5", t=t_runs)

# Tables, whole and cut along both sides.
table = np.stack([x, y, small, p], 1)
for name, dtype, kind in [
    ("whole", "f8", dict()),
    ("rows", "i8", dict(chunks=(1000, 4), compression="gzip")),
    ("columns", "i4", dict(chunks=(1000, 1), compression="gzip")),
    ("pairs", "f8", dict(chunks=(999, 2))),
    ("triples", "f8", dict(chunks=(999, 3))),
]:
    with h5py.File(os.path.join(folder, f"table-{name}.h5"), "w") as file:
        file.create_dataset("davis/left/events", data=table.astype(dtype), **kind)
    done(f"table-{name}.h5", t=small, columns="x,y,t,p", time_unit="us")
for version in ("latest",):
    with h5py.File(os.path.join(folder, "table-tree.h5"), "w", libver=version) as file:
        kind = dict(maxshape=(None, None), chunks=(50, 2))
        file.create_dataset("events", data=table, **kind)
        file.create_dataset("imu", data=np.zeros((3, 6)))
    done("table-tree.h5", t=small, columns="x,y,t,p", time_unit="us")

# A block of the user's before, and a committed type.
columns("user-block.h5", file_options=dict(userblock_size=1024))
done("user-block.h5")
with h5py.File(os.path.join(folder, "committed.h5"), "w") as file:
    file["time"] = np.dtype("i8")
    group = file.create_group("events")
    group.create_dataset("t", data=t, dtype=file["time"])
    for column, values in zip("xyp", (x, y, p)):
        group.create_dataset(column, data=values.astype("u2"))
done("committed.h5")
# Two cameras.
with h5py.File(os.path.join(folder, "two.h5"), "w") as file:
    for camera, shift in (("left", 0), ("right", 5)):
        group = file.create_group(f"{camera}/events")
        for column, values in zip("txyp", (t + shift, x, y, p)):
            group.create_dataset(column, data=values)
done("two.h5", t=t + 5, topic="right/events")
