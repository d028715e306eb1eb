"""Runs operations of eventcv: `peer.py RECORDING WIDTHxHEIGHT FOLDER NAME=EXPRESSION...`

Writes each result's bytes to FOLDER/NAME and prints a line of JSON: name, dtype, shape. Then a line with the names of
all that an `EventStream` can do.
"""

import json
import sys

import eventcv as ecv
import numpy as np

recording, size, folder, *ops = sys.argv[1:]
size = tuple(map(int, size.split("x")))
for op in ops:
    name, expression = op.split("=", 1)
    # What an expression may use: the stream anew, since each takes it as it was read.
    stream = ecv.load(recording, sensor_size=size)
    result = eval(expression, {"s": stream, "ecv": ecv, "np": np})
    array = np.ascontiguousarray(result.numpy() if hasattr(result, "numpy") else result)
    array.tofile(f"{folder}/{name}")
    print(json.dumps([name, str(array.dtype), array.shape]))
print(json.dumps([name for name in dir(ecv.EventStream) if callable(getattr(ecv.EventStream, name)) and name[0] != "_"]))
