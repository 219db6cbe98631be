"""Reads a file of `rig export mcap` with other people's code: python in_foxglove.py FILE TRAJECTORY SERVO FIT.

Each message must fit the schema that the file itself gives for it, and be one of Foxglove's own definitions to the last field. Prints each
topic with its schema and how many messages it has."""
import base64, collections, csv, importlib, json, re, sys

import jsonschema
from google.protobuf import json_format
from mcap.reader import make_reader

path, trajectory, servo, fit = sys.argv[1:]


def as_protobuf(value, key=""):
    """Times as protobuf's JSON has them."""
    if isinstance(value, dict):
        if set(value) == {"sec", "nsec"}:
            if key == "lifetime":
                return f"{value['sec']}.{value['nsec']:09}s"
            from datetime import datetime, timezone
            whole = datetime.fromtimestamp(value["sec"], timezone.utc).strftime("%Y-%m-%dT%H:%M:%S")
            return f"{whole}.{value['nsec']:09}Z"
        return {key: as_protobuf(part, key) for key, part in value.items()}
    if isinstance(value, list):
        return [as_protobuf(part) for part in value]
    return value


counts, times, last, said = collections.Counter(), {}, collections.defaultdict(int), collections.defaultdict(list)
with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    for schema, channel, message in reader.iter_messages():
        value = json.loads(message.data)
        jsonschema.validate(value, json.loads(schema.data))
        package, _, name = schema.name.partition(".")
        if package == "foxglove":
            known = importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2")
            json_format.ParseDict(as_protobuf(value), getattr(known, name)())
        if "timestamp" in value:
            stamp = value["timestamp"]["sec"] * 10**9 + value["timestamp"]["nsec"]
            assert stamp == message.log_time, (channel.topic, stamp, message.log_time)
        counts[channel.topic, schema.name] += 1
        said[channel.topic].append((message.log_time, value))

for (topic, schema), count in sorted(counts.items()):
    print(topic, schema, count)

images, rows = said["/camera/image"], list(csv.DictReader(open(trajectory)))
assert len(images) == len(rows), (len(images), len(rows))
assert base64.b64decode(images[0][1]["data"])[:2] == b"\xff\xd8"
assert [t for t, _ in images] == [t for t, _ in said["/camera/annotations"]] == [t for t, _ in said["/frames"]]
# one clock: an image is as long after the first servo row as the tables say
moves = list(csv.DictReader(open(servo)))
gap = (images[10][0] - said["/servo"][0][0]) * 1e-9
assert abs(gap - (float(rows[10]["time_s"]) - float(moves[0]["time_s"]))) < 1e-6, gap
# errors are those of the fit
angle = next(key for key in moves[0] if re.fullmatch(r"\w+_rad", key) and "measured" not in key)
starts = next(float(a["time_s"]) for a, b in zip(moves, moves[1:]) if a[angle] != b[angle])
origin = images[0][0] - round(float(rows[0]["time_s"]) * 1e9)
for keypoint in json.load(open(fit))["runs"][0]["keypoints"]:
    errors = [value[keypoint["name"]]["error_mm"] for t, value in said["/keypoints"]
              if (t - origin) * 1e-9 >= starts - 1e-6 and "error_mm" in value[keypoint["name"]]]
    mean = sum(errors) / len(errors)
    assert abs(mean - 1e3 * keypoint["mean_error_m"]) < 1e-4 + 1e-3 * mean, (keypoint, mean)
