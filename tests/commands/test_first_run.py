"""The first command after installation says what it waits for, and no later one does."""

from pathlib import Path

import pytest

from backlash_cli.commands.terminal import say_if_first_run


def test_the_wait_is_explained_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                    capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    say_if_first_run()
    assert "first run" in capsys.readouterr().err
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "play.nbi").write_bytes(b"")
    say_if_first_run()
    assert capsys.readouterr().err == ""
