"""Reads the same files by Lobula and by other libraries, in one run, and prints one table.

    python3 benches/peers/run.py [NAME...]        only files whose name contains one of the names

Makes a Python environment in target/peers with the pinned packages below, has `cargo bench --bench formats` write and
read the files, then reads them by each library that knows the format, whole, each in a process of its own. CPU time,
medians of 3, page cache warm. A library that fails or finds another number of events is named with what happened.
"""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from environment import ROOT, python

PACKAGES = [
    "numpy==2.4.6",
    "evutils==0.3.18",
    "eventcv==1.0.8",
    "faery==0.7.1",
    "h5py==3.16.0",
    "hdf5plugin==7.1.0",
    "rosbags==0.11.9",
]


def evutils(path):
    from evutils.io import EventReader

    return sum(len(events) for events in EventReader(path))


def eventcv(path):
    import eventcv as ecv

    return len(ecv.load(path))


def faery(path):
    import faery

    return sum(len(events) for events in faery.events_stream_from_file(path))


def h5py(path):
    import h5py
    import hdf5plugin  # noqa: F401

    with h5py.File(path) as file:
        columns = [file["events"][name][:] for name in "txyp"]
    return len(columns[0])


def numpy(path):
    import numpy as np

    loaded = np.load(path)
    if isinstance(loaded, np.ndarray):
        return len(loaded)
    columns = {name: loaded[name] for name in loaded.files}
    return len(columns["t"])


def others(folder):
    """HDF5 as others write it, and we do not."""
    import h5py
    import hdf5plugin

    kinds = {"contiguous": {}, "blosc-zstd": dict(chunks=(16384,), **hdf5plugin.Blosc("zstd", 5, hdf5plugin.Blosc.SHUFFLE))}
    with h5py.File(f"{folder}/none.h5") as ours:
        for name, kind in kinds.items():
            path = f"{folder}/{name}.h5"
            with h5py.File(path, "w") as file:
                for column in "txyp":
                    file.create_dataset(f"events/{column}", data=ours["events"][column][:], **kind)
            print(path)


def rosbags(path):
    from rosbags.highlevel import AnyReader

    events = 0
    with AnyReader([pathlib.Path(path)]) as reader:
        for connection, _, raw in reader.messages():
            events += len(reader.deserialize(raw, connection.msgtype).events)
    return events


# Which reads what, by the end of the name.
PEERS = {
    ".raw": [evutils, eventcv, faery],
    ".dat": [evutils, eventcv, faery],
    ".aedat4": [evutils, eventcv, faery],
    ".aedat": [evutils, eventcv],
    ".h5": [h5py, evutils, eventcv],
    ".npy": [numpy],
    ".npz": [numpy, eventcv],
    ".csv": [evutils, eventcv],
    ".txt": [evutils, eventcv],
    ".es": [faery],
    ".bag": [rosbags, eventcv],
}


def child(peer, path):
    """Reads once, and prints the number of events and the CPU seconds it took, imports not counted."""
    read = globals()[peer]
    times = []
    for _ in range(3):
        start = time.process_time()
        events = read(path)
        times.append(time.process_time() - start)
    print(json.dumps([int(events), statistics.median(times)]))


def main(names):
    interpreter = python("peers", PACKAGES)
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
        bench = ["cargo", "bench", "--quiet", "-p", "lobula-benches", "--bench", "formats", "--"]
        ours = output([*bench, "--json", "--keep", folder, *names], cwd=ROOT)
        if pathlib.Path(folder, "none.h5").exists():
            written = output([interpreter, __file__, "--child", "others", folder])
            ours += output([*bench, "--json", *(word for path in written for word in ("--read", path))], cwd=ROOT)
        print("| file | Lobula, blocks | Lobula, load, 1 core | peers, whole file (Mev/s of CPU time) |")
        print("|---|---:|---:|---|")
        for line in ours:
            row = json.loads(line)
            path = pathlib.Path(folder) / row["file"]
            told = [f"{peer.__name__} {measure(interpreter, peer, path, row['events'])}" for peer in PEERS.get(path.suffix, [])]
            print(f"| {row['file']} | {row['blocks']:.0f} | {row['load_one_core']:.0f} | {', '.join(told)} |", flush=True)


def output(command, **options):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, **options).stdout.splitlines()


def measure(interpreter, peer, path, events):
    try:
        output = subprocess.run(
            [interpreter, __file__, "--child", peer.__name__, path], capture_output=True, text=True, timeout=300
        )
    except subprocess.TimeoutExpired:
        return "over 300 s"
    if output.returncode != 0:
        return "fails: " + (output.stderr.strip().splitlines() or ["killed"])[-1][:80]
    found, seconds = json.loads(output.stdout.strip().splitlines()[-1])
    rate = f"{events / seconds / 1e6:.1f}"
    return rate if found == events else f"{rate} (finds {found} events, not {events})"


if __name__ == "__main__":
    if sys.argv[1:3] == ["--child", "others"]:
        others(sys.argv[3])
    elif sys.argv[1:2] == ["--child"]:
        child(*sys.argv[2:])
    else:
        main(sys.argv[1:])
