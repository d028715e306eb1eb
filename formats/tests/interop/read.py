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


def rosbags(path):
    """Types are made from the definitions in the file, whose MD5 sums must be those of the connections."""
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    with Reader(path) as bag:
        types = get_typestore(Stores.EMPTY)
        for connection in bag.connections:
            types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            assert types.generate_msgdef(connection.msgtype, ros_version=1)[1] == connection.digest, connection
        events = []
        for connection, _, data in bag.messages():
            message = types.deserialize_ros1(data, connection.msgtype)
            if connection.topic.endswith("events"):
                assert (message.width, message.height) == (1280, 720)
                events += message.events
    t = [event.ts.sec * 1_000_000 + event.ts.nanosec // 1000 for event in events]
    return t, [event.x for event in events], [event.y for event in events], [event.polarity for event in events]


def mcap(path):
    """Types are made from the schemas in the file; then EVT3 word by word."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.EMPTY)
    words = []
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if schema.name not in types.fielddefs:
                types.register(get_types_from_msg(schema.data.decode(), schema.name))
            packet = types.deserialize_cdr(message.data, schema.name)
            if channel.topic.endswith("events"):
                assert (packet.width, packet.height, packet.encoding) == (1280, 720, "evt3")
                assert packet.seq == message.sequence
                words.append(packet.events.tobytes())
    return evt3(np.frombuffer(b"".join(words), "<u2").tolist())


def evt3(words):
    """By the specification, in the plainest way; a TIME_HIGH that falls by more than half its range is a wrap."""
    t, x, y, p = [], [], [], []
    high, low, row, base, polarity = 0, 0, 0, 0, 0
    for word in words:
        kind, value = word >> 12, word & 0xFFF
        if kind == 0x0:
            row = value & 0x7FF
        elif kind == 0x2:
            t.append(high << 12 | low), x.append(value & 0x7FF), y.append(row), p.append(value >> 11)
        elif kind == 0x3:
            base, polarity = value & 0x7FF, value >> 11
        elif kind in (0x4, 0x5):
            width = 12 if kind == 0x4 else 8
            for bit in range(width):
                if value >> bit & 1:
                    t.append(high << 12 | low), x.append(base + bit), y.append(row), p.append(polarity)
            base += width
        elif kind == 0x6:
            low = value
        elif kind == 0x8:
            before = high & 0xFFF
            wrapped = before > value and before - value > 2048
            if value != before:
                low = 0
            high = (high - before) + value + (4096 if wrapped else 0)
    return t, x, y, p


def numpy_load(path):
    events = np.load(path)
    if path.endswith(".npz"):
        assert events["time_unit"] == "us" and list(events["sensor_size"]) == [1280, 720]
    else:
        assert len(np.load(path, mmap_mode="r")) == len(events)
    return events["t"], events["x"], events["y"], events["p"]


def numpy_loadtxt(path):
    from decimal import Decimal

    if path.endswith(".txt"):
        t, *columns = np.loadtxt(path, dtype=str).T
        t = np.array([int(Decimal(one) * 1_000_000) for one in t])
    else:
        t, *columns = np.loadtxt(path, dtype=np.int64, delimiter=",", skiprows=2).T
    return t, *(column.astype(np.int64) for column in columns)


peer = {read.__name__: read for read in (faery, dv, aedat, evlib, evutils, hdf5, rosbags, mcap, numpy_load, numpy_loadtxt)}[sys.argv[1]]
for path in sys.argv[2:]:
    columns = peer(path)
    events = np.empty(len(columns[0]), DIGEST)
    for name, column in zip(DIGEST.names, columns):
        events[name] = column
    print(len(events), hashlib.sha256(events.tobytes()).hexdigest())
