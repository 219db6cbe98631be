"""Reads a file of `rig export bluesky` with other people's code: python in_bluesky.py FILE RUN.

Each document must fit the event model's own schema, refer to those before it, and give the tables of the run folder back. Prints each stream
with the number of its events."""
import csv, json, math, pathlib, sys

from event_model import DocumentNames, RunRouter, SingleRunDocumentRouter, schema_validators

path, run = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
assert "NaN" not in path.read_text()
documents = [json.loads(line) for line in path.read_text().splitlines()]
names = [name for name, _ in documents]
assert names[0] == "start" and names[-1] == "stop" and set(names) == {"start", "descriptor", "event", "stop"}, set(names)
streams, uids, collector = {}, set(), SingleRunDocumentRouter()
router = RunRouter([lambda name, document: ([collector], [])])
for name, document in documents:
    schema_validators[DocumentNames[name]].validate(document)
    router(name, document)
    assert document["uid"] not in uids
    uids.add(document["uid"])
    if name == "descriptor":
        streams[document["uid"]] = document["name"], document["data_keys"], []
    if name == "event":
        _, keys, events = streams[document["descriptor"]]
        assert set(document["data"]) == set(document["timestamps"]) == set(keys)
        assert document["seq_num"] == len(events) + 1
        events.append(document)
start, stop = documents[0][1], documents[-1][1]
origin = json.loads((run / "start.json").read_text())
assert start["uid"] == origin["id"] and stop["run_start"] == start["uid"] and stop["exit_status"] == "success"
assert stop["num_events"] == {name: len(events) for name, _, events in streams.values()}
assert 0 < stop["time"] - start["time"] < 600
for name, table in (("primary", "trajectory.csv"), ("servo", "servo.csv"), ("images", "frames.csv")):
    rows = list(csv.DictReader((run / table).open()))
    ((keys, events),) = [(keys, events) for stream, keys, events in streams.values() if stream == name]
    assert len(rows) == len(events) > 1
    for row, event in zip(rows, events):
        assert math.isclose(event["time"] - start["time"], float(row["time_s"]), abs_tol=1e-6)
        for column, cell in row.items():
            kept, kind = event["data"][column], keys[column]["dtype"]
            wanted = cell if kind == "string" else cell == "true" if kind == "boolean" else float(cell) if cell else None
            assert kept == wanted, (column, kept, cell)
    print(name, len(events), {column: key.get("units") for column, key in keys.items()})
print("journal", stop["num_events"]["journal"])
