"""Runs the operations of `report` by Lobula and by Python libraries, in one run, and prints one table.

    python3 benches/peers/operations.py [NAME...]       only operations of these names
    python3 benches/peers/operations.py --sizes [N...]  `count` of 10^3 to 10^8 events, or of 10^N

Makes a Python environment in target/operations with the pinned packages below, has `report` run ours, and hands the
same recording, repeated in time, to each library, in memory and in the form it likes best. 1220000 events of
1280x720; CPU time of one core, medians of 5 after a first run; each library in a process of its own.
What is compared is the work and not every bit: the last column says how a peer's differs. Equality with eventcv is
what tests/parity is for. event_utils is not in the package index; numpy's bincount, which is quicker than its way,
stands for it.
"""

import functools
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
    "dv-processing==2.0.4",
    "eventcv==1.0.8",
    "evlib==0.13.2",
    "evutils==0.3.18",
    "numba==0.68.1",
    "polars==2.1.0",
    "scipy==1.17.1",
    "setuptools==65.5.0",
    "tonic==1.7.0",
]
WIDTH, HEIGHT = SIZE = (1280, 720)
EVENTS = 1_220_000
SIZES = range(3, 9)  # powers of 10
BYTES_HOLD = 10**7  # events; of more, counts of many pixels pass 255, and ours are u16
RECORDING = "evt3_gen41_1280x720.raw"


def recording():
    return pathlib.Path(os.environ.get("LOBULA_SHARED", ROOT.parent / "shared")) / "data" / RECORDING


class Events:
    """The first `count` events of the recording repeated in time, in the forms of the libraries."""

    def __init__(self, count):
        self.count = count

    @functools.cached_property
    def columns(self):
        import eventcv
        import numpy as np

        once = eventcv.load(str(recording()), sensor_size=SIZE).numpy()
        copies = -(-self.count // len(once))
        x, y, t, p = (np.tile(once[:, i], copies)[: self.count] for i in range(4))
        span = int(once[:, 2].max() - once[:, 2].min()) + 1
        t = t + np.repeat(np.arange(copies, dtype=np.uint64) * np.uint64(span), len(once))[: self.count]
        return x.astype("u2"), y.astype("u2"), t.astype("i8"), p.astype("u1")

    @functools.cached_property
    def eventcv(self):
        import eventcv
        import numpy as np

        x, y, t, p = self.columns
        with tempfile.TemporaryDirectory() as folder:
            path = f"{folder}/events.npz"
            size = dict(width=np.uint64(WIDTH), height=np.uint64(HEIGHT), timestamp_scale_ms=1e-3)
            np.savez(path, x=x, y=y, t=t, p=p, **size)
            return eventcv.load(path)

    def structured(self, **types):
        import numpy as np

        columns = dict(zip("xytp", self.columns))
        events = np.empty(self.count, dtype=list(types.items()))
        for name in types:
            events[name] = columns[name]
        return events

    @functools.cached_property
    def tonic(self):
        return self.structured(x="i2", y="i2", t="i8", p="?")

    @functools.cached_property
    def evutils(self):
        return self.structured(t="i8", x="u2", y="u2", p="u1")

    @functools.cached_property
    def evlib(self):
        import polars as pl

        x, y, t, p = self.columns
        columns = {"x": x.astype("i2"), "y": y.astype("i2"), "t": t, "polarity": p.astype("i1") * 2 - 1}
        return pl.DataFrame(columns).with_columns(pl.col("t").cast(pl.Duration("us")))

    @functools.cached_property
    def dv(self):
        import dv_processing as dv

        store = dv.EventStore()
        t_newest = 0
        for start in range(0, self.count, 10**6):  # lists take 30 times the memory
            for x, y, t, p in zip(*(column[start : start + 10**6].tolist() for column in self.columns)):
                t_newest = max(t, t_newest)  # it refuses a step back
                store.push_back(t_newest, x, y, bool(p))
        return store

    @property
    def duration_ms(self):
        t = self.columns[2]
        return float(t.max() - t.min()) / 1e3


def numpy_count(events):
    import numpy as np

    x, y, _, _ = events.columns
    return np.bincount(y.astype(np.int64) * WIDTH + x, minlength=WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)


def numpy_polarity(events):
    import numpy as np

    x, y, _, p = events.columns
    at = (p == 0) * (WIDTH * HEIGHT) + y.astype(np.int64) * WIDTH + x
    return np.bincount(at, minlength=2 * WIDTH * HEIGHT).reshape(2, HEIGHT, WIDTH)


def dv_surface(events):
    import dv_processing as dv

    surface = dv.TimeSurface(SIZE)
    surface.accept(events.dv)
    return surface.generateFrame()


def dv_sits(events):
    import dv_processing as dv

    surface = dv.SpeedInvariantTimeSurface(SIZE)
    surface.accept(events.dv)
    return surface.generateFrame()


def dv_edges(events):
    import dv_processing as dv

    accumulator = dv.EdgeMapAccumulator(SIZE)
    accumulator.accept(events.dv)
    return accumulator.generateFrame()


def dv_filtered(make):
    def run(events):
        noise_filter = make()
        noise_filter.accept(events.dv)
        return noise_filter.generateEvents()

    return run


def dv_call(name, *args):
    def run(events):
        import dv_processing as dv

        return getattr(dv, name)(events.dv, *args)

    return run


@functools.cache
def four_of_five_pixels():
    """Those of `mask` in `report`."""
    import numpy as np

    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return ((x * 7 + y * 3) % 5 != 0).astype("u1")


def dv_inside(events):
    return dv_call("maskFilter", four_of_five_pixels())(events)


@functools.cache
def dv_camera():
    """That of `undistort` in `report`."""
    import dv_processing as dv

    lens = [-0.3, 0.1, 0.0003, 0.0002, 0.0]
    return dv.camera.CameraGeometry(lens, 1000, 1000, 640, 360, SIZE, dv.camera.DistortionModel.RADIAL_TANGENTIAL)


def dv_undistorted(events):
    return dv_camera().undistortEvents(events.dv)


def dv_picture(events):
    import dv_processing as dv

    return dv.visualization.EventVisualizer(SIZE).generateImage(events.dv)


def middle_half(events):
    t = events.columns[2]
    quarter = int(t.max() - t.min()) // 4
    return int(t.min()) + quarter, int(t.max()) - quarter


def tonic_window(events):
    import tonic.transforms

    return tonic.transforms.CropTime(*middle_half(events))(events.tonic)


def evlib_window(events):
    import evlib

    return evlib.filtering.filter_by_time(events.evlib, *(t / 1e6 for t in middle_half(events))).collect()


@functools.cache
def halves(events):
    """ON and OFF events."""
    on = events.evutils["p"] == 1
    return events.evutils[on], events.evutils[~on]


def numpy_merged(events):
    import numpy as np

    both = np.concatenate(halves(events))
    return both[both["t"].argsort(kind="stable")]


def dv_background_activity():
    from datetime import timedelta

    import dv_processing as dv

    return dv.noise.BackgroundActivityNoiseFilter(SIZE, timedelta(milliseconds=1))


def tonic(name, *args, **options):
    def run(events):
        import tonic.transforms

        return getattr(tonic.transforms, name)(*args, **options)(events.tonic)

    return run


def evutils(name, *args, **options):
    def run(events):
        import evutils.dense
        import evutils.transforms.functional as functional

        return (getattr(evutils.dense, name, None) or getattr(functional, name))(events.evutils, *args, **options)

    return run


def evlib(name, *args, **options):
    def run(events):
        import evlib

        call = getattr(evlib.representations, name, None) or getattr(evlib.filtering, name)
        result = call(events.evlib, *args, **options)
        return result.collect() if hasattr(result, "collect") else result

    return run


def eventcv(name, *args, **options):
    def run(events):
        return getattr(events.eventcv, name)(*args, **options)

    return run


SENSOR = (WIDTH, HEIGHT, 2)
SEEDED = {"seed": 1}

# Operation of `report`: what each library calls it. A note in brackets where it does something else.
PEERS = {
    "count": {"numpy": numpy_count, "eventcv": eventcv("count"), "dv (saturating u8)": dv_edges,
              "tonic (2 planes)": tonic("ToFrame", sensor_size=SENSOR, n_time_bins=1),
              "evlib (2 planes)": evlib("create_event_frame", HEIGHT, WIDTH, n_time_bins=1)},
    "polarity": {"numpy": numpy_polarity, "eventcv": eventcv("flatten", normalize=False),
                 "evutils (u8, wraps)": evutils("histogram"),
                 "tonic": tonic("ToFrame", sensor_size=SENSOR, n_time_bins=1),
                 "evlib": evlib("create_event_frame", HEIGHT, WIDTH, n_time_bins=1)},
    "voxel5": {"eventcv": lambda events: events.eventcv.voxel(bins=5, window_ms=events.duration_ms),
               "tonic": tonic("ToVoxelGrid", sensor_size=SENSOR, n_time_bins=5),
               "evlib": evlib("create_voxel_grid", HEIGHT, WIDTH, n_time_bins=5)},
    "time_surface": {"eventcv": eventcv("tsurf", tau_ms=30), "evutils (1 plane)": evutils("timesurface"),
                     "dv (1 plane, i64)": dv_surface},
    "averaged_time_surface": {"eventcv": eventcv("atsurf", tau_ms=30)},
    "sits": {"dv (1 plane)": dv_sits},
    "tore": {"evutils (u8)": evutils("tore", n_events=4)},
    "event_image": {"eventcv": eventcv("raw_image"), "dv (no fading)": dv_picture,
                    "evutils (no fading)": evutils("frame_rgb")},
    "stacked_histogram": {"evlib": evlib("create_stacked_histogram", HEIGHT, WIDTH, bins=5)},
    "mixed_density_stack": {"evlib": evlib("create_mixed_density_stack", HEIGHT, WIDTH)},
    "refractory": {"eventcv": eventcv("refractory_filter", 1000), "evutils": evutils("refractory_period", 1000),
                   "tonic": tonic("RefractoryPeriod", 1000),
                   "evlib": evlib("filter_noise", method="refractory", refractory_period_us=1000)},
    "background_activity": {"eventcv": eventcv("background_activity_filter", 1000),
                            "dv": dv_filtered(dv_background_activity),
                            "tonic": tonic("Denoise", filter_time=1000)},
    "hot_pixel": {"eventcv": eventcv("hot_pixel_filter", 3.0),
                  "evlib (percentile)": evlib("filter_hot_pixels", threshold_percentile=99.9)},
    "keep_polarity": {"dv": dv_call("polarityFilter", True), "eventcv": eventcv("filter_polarity", True),
                      "evlib": evlib("filter_by_polarity", 1)},
    "region_of_interest": {"dv": dv_call("roiFilter", (160, 120, 960, 480)),
                           "evlib": evlib("filter_by_roi", 160, 1119, 120, 599)},
    "mask": {"dv": dv_inside},
    "decimate": {"eventcv": eventcv("decimate", 4), "tonic (of each pixel)": tonic("Decimation", 4)},
    "flip_x": {"eventcv": eventcv("flip_x"), "evutils": evutils("flip_lr", SENSOR),
               "tonic": tonic("RandomFlipLR", sensor_size=SENSOR, p=1.0)},
    "flip_y": {"eventcv": eventcv("flip_y"), "tonic": tonic("RandomFlipUD", sensor_size=SENSOR, p=1.0)},
    "crop": {"eventcv": eventcv("crop", 160, 120, 960, 480), "tonic": tonic("CenterCrop", SENSOR, (960, 480))},
    "scale": {"dv": dv_call("scale", 2.0, 2.0), "eventcv": eventcv("scale", 0.5, 0.5),
              "tonic": tonic("Downsample", spatial_factor=0.5)},
    "undistort": {"dv": dv_undistorted},
    "invert_polarity": {"eventcv": eventcv("invert_polarity"), "tonic": tonic("RandomFlipPolarity", p=1.0)},
    "time_scale": {"eventcv": eventcv("time_scale", 2.5), "evutils": evutils("time_skew", 2.5),
                   "tonic": tonic("TimeSkew", 2.5)},
    "time_window": {"evlib": evlib_window, "tonic": tonic_window},
    "normalize_time": {"eventcv": eventcv("normalize_time"), "evutils": evutils("normalize_ts")},
    "event_drop": {"eventcv": eventcv("event_drop", 0.5, seed=1), "evutils": evutils("drop_random_events", 0.5, **SEEDED),
                   "tonic": tonic("DropEvent", p=0.5)},
    "pixel_dropout": {"eventcv": eventcv("pixel_dropout", 0.1, seed=1)},
    "drop_by_area": {"tonic": tonic("DropEventByArea", SENSOR, 0.5)},
    "spatial_jitter": {"eventcv": eventcv("spatial_jitter", 1.0, seed=1),
                       "evutils": evutils("spatial_jitter", SENSOR), "tonic": tonic("SpatialJitter", sensor_size=SENSOR)},
    "time_jitter": {"evutils": evutils("time_jitter"), "tonic": tonic("TimeJitter", std=1)},
    "random_crop": {"eventcv": eventcv("random_crop", 640, 360, seed=1), "tonic": tonic("RandomCrop", SENSOR, (640, 360))},
    "merge": {"numpy": numpy_merged},
}


def child(operation, peer, count):
    """Does it again and again, and prints the CPU seconds once took, imports and preparation not counted."""
    call, events = PEERS[operation][peer], Events(int(count))
    times = []
    for _ in range(6 if int(count) < 10**7 else 3):
        start = time.process_time()
        result = call(events)
        times.append(time.process_time() - start)
        assert result is not None
    print(json.dumps(statistics.median(times[1:])))


def measure(interpreter, operation, peer, count):
    """Milliseconds, or a sentence."""
    environment = dict(os.environ, POLARS_MAX_THREADS="1", OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1")
    command = [interpreter, __file__, "--child", operation, peer, str(count)]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment)
    except subprocess.TimeoutExpired:
        return "over 600 s"
    if run.returncode != 0:
        return "fails: " + (run.stderr.strip().splitlines() or ["killed"])[-1][:80]
    return json.loads(run.stdout.strip().splitlines()[-1]) * 1e3


def ours(*options):
    """Lines of `report`, the quickest kernel of each operation in protocol `stream`, as milliseconds for EVENTS."""
    report = ["cargo", "run", "--quiet", "--release", "-p", "lobula-benches", "--bin", "report", "--"]
    command = [*report, "--json", "--events", str(EVENTS), *options]
    lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout.splitlines()
    best = {}
    for line in map(json.loads, lines):
        if line["protocol"] == "stream":
            took = line["ours"] if line["unit"] == "ms" else EVENTS / line["ours"] / 1e3
            best[line["op"]] = min(took, best.get(line["op"], took))
    return best


def row(interpreter, title, operation, count, took):
    times = {peer: measure(interpreter, operation, peer, count) for peer in PEERS[operation]}
    told = [f"{peer} {took:.4g}" if isinstance(took, float) else f"{peer} {took}" for peer, took in times.items()]
    best = min((took for took in times.values() if isinstance(took, float)), default=None)
    ratio = f"{best / took:.1f}" if best else "-"
    print(f"| {title} | {took:.4g} | {ratio} | {', '.join(told)} |", flush=True)


def main(names):
    if not recording().exists():
        sys.exit(f"{recording()}: no such file; set LOBULA_SHARED to the folder that has data/{RECORDING}")
    interpreter = python("operations", PACKAGES)
    if names[:1] == ["--sizes"]:
        print("| `count` of events | Lobula, ms | times as fast as the quickest | peers, ms of CPU time |")
        print("|---|---:|---:|---|")
        for count in (10 ** int(power) for power in names[1:] or SIZES):
            name = "count" if count <= BYTES_HOLD else "count_u16"
            took = ours("--only", name, "--tensor-events", str(count))[name]
            row(interpreter, count, "count", count, took)
        return
    best = ours(*(option for name in names or PEERS for option in ("--only", name)))
    print("| operation | Lobula, ms | times as fast as the quickest | peers, ms of CPU time |")
    print("|---|---:|---:|---|")
    for operation in PEERS:
        if operation in best and (not names or operation in names):
            row(interpreter, operation, operation, EVENTS, best[operation])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(*sys.argv[2:])
    else:
        main(sys.argv[1:])
