"""`robotctl view` as a process."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import urllib.request

import pytest

from tests.workbench.view.recorded import write_run

LINK = re.compile(r"replay: (http://127\.0\.0\.1:(\d+)/)")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_a_link_to_the_page_until_it_is_interrupted(tmp_path, end):
    folder = write_run(tmp_path / "drive", 3, is_cut=True)
    command = [sys.executable, "-m", "robotctl", "view", str(folder)]
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)  # the second takes the next port
    ]
    try:
        links = [LINK.search(each.stdout.readline()) for each in processes]
        assert len({link[2] for link in links}) == 2
        for link in links:
            with urllib.request.urlopen(link[1], timeout=10.0) as answer:
                assert b'data-replay="1"' in answer.read()
        for each in processes:
            each.send_signal(end)
        for each in processes:
            out, err = each.communicate(timeout=20.0)
            assert (each.returncode, out) == (0, "")
            assert "note: " in err
            assert "was not closed" in err
    finally:
        for each in processes:
            each.kill()
            each.communicate()
