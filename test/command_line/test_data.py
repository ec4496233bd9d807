# SPDX-License-Identifier: Apache-2.0
"""`mild data`: what there is, and a fetched file that is whole and right, or none."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from mild_core.learning import datasets
from mild_core.learning.data.recording import Demonstrations, Download
from mild_core.learning.datasets import DATASETS, NUISI
from mild_ros.command_line.main import main

CONTENT = b"trials" * 50_000


@pytest.fixture
def publisher() -> Iterator[str]:
    """The address of a server on this machine that gives `CONTENT`, more than it, or as much of something else."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            given = {"/more": CONTENT + b"more", "/other": CONTENT[::-1]}.get(self.path, CONTENT)
            self.wfile.write(given)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def ended(*words: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        main(["data", *words])
    return int(exit_.value.code or 0)


BY_SHA256 = Download("", sha256=hashlib.sha256(CONTENT).hexdigest(), size_bytes=len(CONTENT))
BY_GIT = Download("", git_blob="48859e8a1ea696337b3552e2007a746ec4f10184")
"""What `git hash-object` prints of that content; its size is not known."""


def offer(monkeypatch: pytest.MonkeyPatch, url: str, known: Download = BY_SHA256) -> None:
    download = replace(known, url=url)
    offered = replace(NUISI, download=download, read=lambda _: Demonstrations((), ()))
    monkeypatch.setitem(datasets.DATASETS, "nuisi", offered)


def test_every_recording_is_listed_with_its_licence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MILD_DATA", str(tmp_path))
    assert ended() == 0
    shown = " ".join(capsys.readouterr().out.split())
    for recording in DATASETS.values():
        assert f"{recording.name} not here" in shown
        assert " ".join(f"licence: {recording.licence}".split()) in shown
    assert "MILD_DATA" in shown


@pytest.mark.parametrize("known", [BY_SHA256, BY_GIT])
def test_a_fetched_recording_lies_where_training_looks_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, publisher: str, known: Download
) -> None:
    monkeypatch.setenv("MILD_DATA", str(tmp_path))
    offer(monkeypatch, publisher + "/", known)
    assert ended("nuisi") == 0
    assert NUISI.default_path().read_bytes() == CONTENT


@pytest.mark.parametrize("known", [BY_SHA256, BY_GIT])
@pytest.mark.parametrize("path", ["/more", "/other", None])
def test_what_is_not_whole_and_right_is_not_kept(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    publisher: str,
    path: str | None,
    known: Download,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("MILD_DATA", str(tmp_path))
    offer(monkeypatch, "http://127.0.0.1:9/" if path is None else publisher + path, known)
    assert ended("nuisi") == 2
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    assert str(tmp_path / "nuisi" / "traj_data.npz") in said, "the remedy says what to put where"
    assert list((tmp_path / "nuisi").iterdir()) == []


def test_without_a_setting_the_folder_is_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MILD_DATA", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("mild_core.learning.data.recording.__file__", str(tmp_path / "a" / "b" / "c" / "d" / "e.py"))
    assert NUISI.default_path() == tmp_path / "mild_ros" / "data" / "nuisi" / "traj_data.npz"
