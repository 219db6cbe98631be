"""The block of the package's README, as it stands, beside all that it names."""

import os
import re
import socket
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest

NEEDED = {"RIG_RUN", "RIG_PROGRAM", "RIG_CONFIG"}


@pytest.mark.skipif(not NEEDED <= set(os.environ), reason=f"{', '.join(sorted(NEEDED))} name no run, program and rig")
def test_what_the_readme_shows(experiment, data, tmp_path, monkeypatch, capsys):
    sio = pytest.importorskip("sleap_io")
    pytest.importorskip("movement")
    pytest.importorskip("pandas")
    text = (Path(__file__).parents[1] / "README.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)

    toml = experiment("least-squares")
    (tmp_path / "chain.xml").rename(tmp_path / "drop.xml")
    toml.write_text(toml.read_text().replace("chain.xml", "drop.xml"))
    (tmp_path / "chain.xml").write_text((data / "chain_active.xml").read_text())
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / re.search(r'Run\("runs/([^"]+)"', block)[1]).symlink_to(os.environ["RIG_RUN"])
    skeleton = sio.Skeleton(["base", "tip"])
    instance = sio.Instance.from_numpy([[1.0, 2.0], [3.0, 4.0]], skeleton=skeleton)
    video = sio.Video(filename="film.mp4", open_backend=False)
    frame = sio.LabeledFrame(video=video, frame_idx=0, instances=[instance])
    sio.save_slp(sio.Labels(videos=[video], skeletons=[skeleton], labeled_frames=[frame]), str(tmp_path / "labels.slp"))

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    block = block.replace("127.0.0.1:8071", f"127.0.0.1:{port}")
    daemon = [os.environ["RIG_PROGRAM"], "daemon", os.environ["RIG_CONFIG"], "--runs-dir", str(tmp_path / "made"), "--listen", f"127.0.0.1:{port}"]
    with subprocess.Popen(daemon, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            _wait_for(f"http://127.0.0.1:{port}/api/v1/rigs")
            monkeypatch.setenv("RIG_TOKEN", (tmp_path / "made" / ".token").read_text().strip())
            monkeypatch.chdir(tmp_path)
            names = {}
            exec(compile(block, "README.md", "exec"), names)
            assert names["job"].state == "done" and names["job"].run.fit.noise_m > 0
        finally:
            process.terminate()
    assert names["motion"].qpos.shape == (3, 101, 3) and names["motion"].jacobian.keypoint_m.shape == (3, 101, 3, 3, 7)
    assert names["d"].verdict == "nothing-detectable" and names["marks"].names == ["base", "tip"]
    assert names["ds"].sizes["time"] == len(names["run"].trajectory)
    assert "nothing-detectable" in capsys.readouterr().out


def _wait_for(url: str) -> None:
    until = time.monotonic() + 30.0
    while True:
        try:
            urllib.request.urlopen(url, timeout=5.0).close()
            return
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)
