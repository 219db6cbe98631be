"""Jobs of a rig, by a daemon that is the program itself."""

import os
import re
import socket
import subprocess
import time

import pytest
import tankrig as rig


def test_where_nobody_serves():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(rig.HardwareError, match="is the daemon running"):
        rig.Daemon(f"http://127.0.0.1:{port}")
    with pytest.raises(rig.InputError, match="no address"):
        rig.Daemon("127.0.0.1:8071")


@pytest.mark.skipif(not {"RIG_PROGRAM", "RIG_CONFIG"} <= set(os.environ), reason="RIG_PROGRAM and RIG_CONFIG name no rig")
def test_a_run_from_the_queue(tmp_path):
    runs = tmp_path / "runs"
    command = [os.environ["RIG_PROGRAM"], "daemon", os.environ["RIG_CONFIG"], "--runs-dir", str(runs), "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            url = next(found[0] for line in process.stdout if (found := re.search(r"http://127\.0\.0\.1:\d+", line)))
            client = rig.Daemon(url, token_file=runs / ".token")
            job = client.run(film_only=True, why="a test")
            states = []
            job.wait(120.0, lambda record: states.append(record.state))
            assert states[-1] == "done" and job.state == "done"
            assert job.run.stop.images > 0 and job.run.path.parent == runs
            # only filmed: nothing has been made of the recording yet
            with pytest.raises(rig.DataError, match="rig replay"):
                job.run.images
            assert [other.id for other in client.jobs()][:1] == [job.id]
            later = client.run(why="not now")
            later.cancel("enough")
            with pytest.raises(rig.DataError, match=f"job {later.id} is cancelled"):
                later.wait(60.0)
            with pytest.raises(rig.InputError, match="token_file"):
                rig.Daemon(url).run()
            with pytest.raises(rig.InputError):
                client.job(10_000).record
        finally:
            process.terminate()
            began = time.monotonic()
            process.wait(30.0)
            assert time.monotonic() - began < 10.0
