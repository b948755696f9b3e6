"""Files are written as a whole and never through a link; what is hidden belongs to one living process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ensemble_ctrl.core.storage import (
    HIDDEN,
    NotRegular,
    claim,
    exchange,
    hidden_name,
    hold,
    open_new,
    put_file,
    read_regular,
    release,
    sweep,
    whole_file,
)


def test_a_link_is_replaced_and_never_followed(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    for name in ("to_file", "to_nothing", "grows"):
        (tmp_path / name).symlink_to("mine.txt" if name != "to_nothing" else "nothing")
    put_file(tmp_path / "to_file", "new")
    put_file(tmp_path / "to_nothing", b"new")
    with open_new(tmp_path / "grows") as file:
        file.write("new")
    assert mine.read_text() == "mine"
    for name in ("to_file", "to_nothing", "grows"):
        assert not (tmp_path / name).is_symlink()
        assert (tmp_path / name).read_text() == "new"
    assert not (tmp_path / "nothing").exists()


def test_a_new_file_leaves_what_is_there_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nothing")
    for name in ("file", "link", "."):
        with pytest.raises(FileExistsError):
            put_file(tmp_path / name, "new", new=True)
    assert sorted(os.listdir(tmp_path)) == ["file", "link"]
    assert (tmp_path / "file").read_text() == "mine"
    put_file(tmp_path / "new", "new", new=True)
    assert (tmp_path / "new").read_text() == "new"


def test_another_file_that_came_while_a_new_one_was_written_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "x"

    def write() -> None:
        with whole_file(path, new=True) as file:
            file.write(b"ours")
            path.write_text("theirs")

    with pytest.raises(FileExistsError):
        write()
    assert path.read_text() == "theirs"
    assert os.listdir(tmp_path) == ["x"]


def test_a_failed_write_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_text("before")

    def write(error: Exception) -> None:
        with whole_file(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(OSError, match="disk is full") as caught:
        write(OSError(28, "the disk is full"))
    assert caught.value.filename == str(path)
    with pytest.raises(ZeroDivisionError):
        write(ZeroDivisionError())
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["x"]


def test_folders_pipes_and_devices_are_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    for name, message in ((".", "Is a directory"), ("pipe", "not a regular file"), ("null", "not a regular file")):
        with pytest.raises(OSError, match=message):
            put_file(tmp_path / name, "x")
    assert sorted(os.listdir(tmp_path)) == ["null", "pipe"]


def test_the_usual_permissions(tmp_path: Path) -> None:
    put_file(tmp_path / "x", "x")
    (tmp_path / "y").write_text("y")
    assert (tmp_path / "x").stat().st_mode == (tmp_path / "y").stat().st_mode


def test_names_that_are_no_text_are_escaped(tmp_path: Path) -> None:
    put_file(tmp_path / "x", "a\udcffb")
    assert (tmp_path / "x").read_bytes() == b"a\\udcffb"


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    began = time.monotonic()
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(NotRegular, match="not a regular file"):
            read_regular(path, 10)
    assert time.monotonic() - began < 5.0
    with pytest.raises(IsADirectoryError):
        read_regular(tmp_path, 10)
    put_file(tmp_path / "x", "0123456789")
    assert read_regular(tmp_path / "x", 4) == b"01234"


LEAVE = """
import os, sys
from pathlib import Path
from ensemble_ctrl.core.storage import claim, hidden_name, whole_file
folder = Path(sys.argv[1])
claim(folder / hidden_name())
(folder / hidden_name()).mkdir()
with whole_file(folder / "x") as file:
    file.write(b"half")
    print("written", flush=True)
    sys.stdin.read()
    os.kill(os.getpid(), 9)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_has_is_not(tmp_path: Path) -> None:
    other = subprocess.Popen(
        [sys.executable, "-c", LEAVE, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert other.stdout is not None
    assert other.stdin is not None
    assert other.stdout.readline() == b"written\n"
    (tmp_path / ".ensemble-plan-link00000000").symlink_to(tmp_path)
    sweep(tmp_path)
    held = [name for name in os.listdir(tmp_path) if HIDDEN.fullmatch(name)]
    assert len(held) == 2  # the folder that nobody held is gone
    other.stdin.close()
    other.wait(timeout=30)
    other.stdout.close()
    put_file(tmp_path / "y", "y")
    assert sorted(os.listdir(tmp_path)) == [".ensemble-plan-link00000000", "y"]


def test_a_claim_is_one_process_s(tmp_path: Path) -> None:
    place = tmp_path / hidden_name()
    held = claim(place)
    assert held is not None
    (place / "half").write_text("x")
    with pytest.raises(BlockingIOError):
        claim(place)
    with pytest.raises(BlockingIOError):
        hold(place)
    assert (place / "half").exists()
    release(held)
    again = claim(place)
    assert list(place.iterdir()) == []
    release(again)


def test_a_claim_does_not_follow_links(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis").write_text("mine")
    (tmp_path / "link").symlink_to("mine")
    with pytest.raises(OSError, match="symbolic links"):
        claim(tmp_path / "link")
    assert (tmp_path / "mine/thesis").exists()


def test_two_folders_are_exchanged(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    exchange(tmp_path / "a", tmp_path / "b")
    assert os.listdir(tmp_path / "a") == ["b"]
    assert os.listdir(tmp_path / "b") == ["a"]
    with pytest.raises(OSError, match="No such file"):
        exchange(tmp_path / "a", tmp_path / "missing")
