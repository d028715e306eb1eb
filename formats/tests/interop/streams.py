"""Every kind of stream by dv-processing: `streams.py write FILE COMPRESSION` or `streams.py read FILE`.

Prints a line for each event, trigger, sample (in 64ths of its units) and frame.
"""

import sys

import dv_processing as dv
import numpy as np

SAMPLE = (
    "temperature accelerometerX accelerometerY accelerometerZ gyroscopeX gyroscopeY gyroscopeZ "
    "magnetometerX magnetometerY magnetometerZ"
).split()
EDGES = {
    dv.TriggerType.EXTERNAL_SIGNAL_RISING_EDGE: "0 1",
    dv.TriggerType.EXTERNAL_SIGNAL_FALLING_EDGE: "0 0",
    dv.TriggerType.EXTERNAL_SIGNAL_PULSE: "0 1",
    dv.TriggerType.EXTERNAL_GENERATOR_RISING_EDGE: "1 1",
    dv.TriggerType.EXTERNAL_GENERATOR_FALLING_EDGE: "1 0",
}


def event(t, x, y, p):
    print("event", t, x, y, int(p))


def trigger(one):
    if one.type in EDGES:
        print("trigger", one.timestamp, EDGES[one.type])


def sample(one):
    print("imu", one.timestamp, *[round(getattr(one, name) * 64) for name in SAMPLE])


def frame(one):
    height, width = one.image.shape[:2]
    channels = one.image.size // (height * width)
    pixels = np.ascontiguousarray(one.image).astype(f"<u{one.image.itemsize}").tobytes()
    # A sum that depends on the places too.
    total = sum(i % 251 * byte for i, byte in enumerate(pixels))
    exposure = round(one.exposure.total_seconds() * 1e6)
    print("frame", one.timestamp, exposure, one.positionX, one.positionY, width, height, channels, one.image.itemsize, total)


def write(path, compression):
    config = dv.io.MonoCameraWriter.Config("DAVIS346_00000001")
    config.addEventStream((346, 260))
    config.addFrameStream((346, 260))
    config.addImuStream()
    config.addTriggerStream()
    config.compression = getattr(dv.CompressionType, compression)
    writer = dv.io.MonoCameraWriter(path, config)
    start = 1_700_000_000_000_000
    for k in range(12):
        t = start + k * 10_000
        events = dv.EventStore()
        for i in range(1000):
            events.push_back(t + 7 * i, (i * 31 + k) % 346, (i * 17 + k) % 260, i // 3 % 2 == 1)
            event(t + 7 * i, (i * 31 + k) % 346, (i * 17 + k) % 260, i // 3 % 2 == 1)
        writer.writeEvents(events)
        one = dv.Trigger(t + 3, dv.TriggerType(k % 10))
        writer.writeTrigger(one)
        trigger(one)
        one = dv.IMU(t, *[(k * j - 20) / 64 if k % 3 or j < 8 else 0 for j in range(1, 11)])
        writer.writeImu(one)
        sample(one)
        if k % 4 == 0:
            pixels = (np.arange(50 * 40 * [1, 3][k // 4 % 2]) * (k + 7) % 256).astype(np.uint8)
            pixels = pixels.reshape((40, 50) if k // 4 % 2 == 0 else (40, 50, 3))
            one = dv.Frame(t + 5, 900 + k, 3, 4, pixels, dv.FrameSource.SENSOR)
            writer.writeFrame(one)
            frame(one)


def read(path):
    recording = dv.io.MonoCameraRecording(path)
    while (events := recording.getNextEventBatch()) is not None:
        for one in events:
            event(one.timestamp(), one.x(), one.y(), one.polarity())
    while (triggers := recording.getNextTriggerBatch()) is not None:
        for one in triggers:
            trigger(one)
    while (samples := recording.getNextImuBatch()) is not None:
        for one in samples:
            sample(one)
    while (one := recording.getNextFrame()) is not None:
        frame(one)


{"write": write, "read": read}[sys.argv[1]](*sys.argv[2:])
