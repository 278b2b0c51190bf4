"""What a shell offers at the tabulator key."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from hunt_ros.cli.main import VERBS, main


@pytest.fixture
def completed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip('shtab', reason='the extra completion is not installed')
    bash = shutil.which('bash')
    if bash is None:
        pytest.skip('no bash on this machine')
    assert main(['completion', 'bash']) == 0
    script = tmp_path / 'hunt.bash'
    script.write_text(capsys.readouterr().out)
    (tmp_path / 'my_rig.yaml').write_text('')

    def offer(*words: str) -> set[str]:
        told = ' '.join(f"'{word}'" for word in ('hunt', *words))
        code = (
            f'source {script}; COMP_WORDS=({told}); COMP_CWORD={len(words)};'
            ' _shtab_hunt; printf "%s\\n" "${COMPREPLY[@]}"'
        )
        ran = subprocess.run(
            [bash, '-c', code], capture_output=True, text=True, cwd=tmp_path, check=True
        )
        return set(ran.stdout.split())

    return offer


def test_verbs_options_and_files_are_completed(completed) -> None:
    assert completed('') >= set(VERBS)
    assert completed('rep') == {'replay', 'report'}
    assert completed('identify', '--roller') == {'--roller-diameter'}
    assert 'my_rig.yaml' in completed('check', '--rig', 'my')
    assert 'emergency-stop' in completed('call', 'emer')


@pytest.mark.parametrize('shell', ['zsh', 'tcsh'])
def test_other_shells_get_a_script_too(capsys: pytest.CaptureFixture[str], shell: str) -> None:
    pytest.importorskip('shtab', reason='the extra completion is not installed')
    assert main(['completion', shell]) == 0
    assert 'replay' in capsys.readouterr().out
