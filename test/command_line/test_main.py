# SPDX-License-Identifier: Apache-2.0
"""One place lists the commands, imports only the wanted one and reports faults in one line."""

import os
import subprocess
import sys

import pytest

from mild_core.errors import SetupError
from mild_ros.command_line import main as command_line
from mild_ros.command_line.main import COMMANDS, main


def run(*arguments):
    """Exit code of `mild arguments`."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return ended.value.code or 0


@pytest.fixture
def planted(monkeypatch):
    """Puts a function in the place of `mild train`."""

    def plant(function):
        module = type(sys)("planted")
        module.train = function
        monkeypatch.setattr(command_line, "import_module", lambda name: module)

    return plant


def test_help_lists_every_command_and_succeeds(capsys):
    assert run("--help") == 0
    shown = capsys.readouterr().out
    for name in COMMANDS:
        assert f" {name} " in shown


def test_help_imports_neither_torch_nor_numpy_nor_ros():
    code = (
        "import sys\n"
        "from mild_ros.command_line.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(*sorted({'torch', 'numpy', 'rclpy', 'pybullet'} & set(sys.modules)), file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == ""
    assert "evaluate" in done.stdout


def test_a_misspelt_command_is_corrected(capsys):
    assert run("trian") == 2
    assert capsys.readouterr().err == "mild: command line: no such command 'trian'; did you mean 'train'?\n"


def test_a_wrong_set_up_is_one_line_and_exit_code_2(planted, capsys):
    def broken() -> None:
        raise SetupError("the thing", "is broken\n  badly", "mend it")

    planted(broken)
    assert run("train") == 2
    assert capsys.readouterr().err == "mild: the thing: is broken badly; mend it\n"


def test_ctrl_c_is_one_line_and_exit_code_130(planted, capsys):
    def interrupted() -> None:
        raise KeyboardInterrupt

    planted(interrupted)
    assert run("train") == 130
    assert capsys.readouterr().err == "mild: interrupted\n"


def test_a_fault_of_the_disk_is_one_line(planted, tmp_path, capsys):
    def unwritable() -> None:
        (tmp_path / "none" / "file").write_text("x")

    planted(unwritable)
    assert run("train") == 2
    assert capsys.readouterr().err == f"mild: {tmp_path}/none/file: No such file or directory\n"


def test_a_fault_of_ours_shows_where_it_comes_from(planted):
    def faulty() -> None:
        raise ZeroDivisionError

    planted(faulty)
    with pytest.raises(ZeroDivisionError):
        main(["train"])


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_utf8_shows_what_it_can(encoding: str) -> None:
    command = [sys.executable, "-m", "mild_ros.command_line.main", "models"]
    shown = subprocess.run(command, env=dict(os.environ, PYTHONIOENCODING=encoding), capture_output=True, timeout=60)
    assert shown.returncode == 0, shown.stderr
    assert b"yumi_buetepage_ahead" in shown.stdout
