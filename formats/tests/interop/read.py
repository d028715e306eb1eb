"""Reads files by libraries of others: `read.py PEER FILE...` prints a line `events sha256` for each file."""

import hashlib
import sys

import numpy as np

DIGEST = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])


def faery(path):
    import faery

    packets = list(faery.events_stream_from_file(path))
    events = np.concatenate(packets)
    return events["t"], events["x"], events["y"], events["on"]


def dv(path):
    import dv_processing

    recording = dv_processing.io.MonoCameraRecording(path)
    batches = []
    while (batch := recording.getNextEventBatch()) is not None:
        batches.append(batch.numpy())
    events = np.concatenate(batches)
    return events["timestamp"], events["x"], events["y"], events["polarity"]


def aedat(path):
    import aedat

    packets = (packet for packet in aedat.Decoder(path) if "events" in packet)
    events = np.concatenate([packet["events"] for packet in packets])
    return events["t"], events["x"], events["y"], events["on"]


def evlib(path):
    import evlib

    events = evlib.load_events(path, sort=False).collect()
    t = events["t"].to_physical().to_numpy()
    return t, events["x"].to_numpy(), events["y"].to_numpy(), events["polarity"].to_numpy() > 0


def evutils(path):
    from evutils.io import EventReader

    events = np.concatenate(list(EventReader(path)))
    if path.endswith(".aedat"):  # as the file has them, mirrored
        return events["t"], 345 - events["x"], 259 - events["y"], events["p"]
    return events["t"], events["x"], events["y"], events["p"]


def hdf5(path):
    import h5py
    import hdf5plugin  # noqa: F401 (its filters are there once it is imported)

    with h5py.File(path) as file:
        columns = {name: file["events"][name][:] for name in "txyp"}
        t = columns["t"].astype("u8")
        if "t_offset" in file:
            # What the makers of DSEC promise of this index.
            first = file["ms_to_idx"][:]
            assert len(first) == t[-1] // 1000 + 1
            assert all((t[first] >= 1000 * np.arange(len(first)))[1:])
            assert all((t[first[1:] - 1] < 1000 * np.arange(1, len(first))))
            t = t + file["t_offset"][()].astype("u8")
        else:
            assert (file["events"].attrs["width"], file["events"].attrs["height"]) == (1280, 720)
            assert file["events"].attrs["time_unit"] in (b"us", "us")
            assert file["events"].attrs["timestamp_scale_ms"] == 0.001
    return t, columns["x"], columns["y"], columns["p"]


peer = {read.__name__: read for read in (faery, dv, aedat, evlib, evutils, hdf5)}[sys.argv[1]]
for path in sys.argv[2:]:
    columns = peer(path)
    events = np.empty(len(columns[0]), DIGEST)
    for name, column in zip(DIGEST.names, columns):
        events[name] = column
    print(len(events), hashlib.sha256(events.tobytes()).hexdigest())
