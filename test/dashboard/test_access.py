"""Who may view and who may command."""

from __future__ import annotations

from pathlib import Path

import pytest

from hunt_ros.dashboard.access import access
from hunt_ros.errors import ConfigError


def token_file(folder: Path, text: str, mode: int = 0o600) -> str:
    path = folder / 'tokens'
    path.write_text(text)
    path.chmod(mode)
    return str(path)


TOKENS = 'view: aaaaaaaaaaaaaaaa\ncommand: bbbbbbbbbbbbbbbb\n'


def test_beyond_the_loopback_only_with_tokens(tmp_path) -> None:
    assert access('127.0.0.1', '').tokens == ()
    with pytest.raises(ConfigError, match=r'address 0\.0\.0\.0.*token_file'):
        access('0.0.0.0', '')
    rules = access('0.0.0.0', token_file(tmp_path, TOKENS))
    assert rules.right_of('a' * 16) == 'view'
    assert rules.right_of(' ' + 'b' * 16) == 'command'
    assert rules.right_of('b' * 15) == rules.right_of('') == ''


@pytest.mark.parametrize(
    ('text', 'mode', 'words'),
    [
        (TOKENS, 0o644, 'mode 600'),
        ('view: short\n', 0o600, 'at least 16'),
        ('admin: aaaaaaaaaaaaaaaa\n', 0o600, "'admin'"),
        ('view: aaaaaaaaaaaaaaaa\ncommand: aaaaaaaaaaaaaaaa\n', 0o600, 'not the same'),
        ('', 0o600, 'expected a token'),
    ],
)
def test_a_file_of_tokens_that_cannot_be_trusted_is_refused(tmp_path, text, mode, words) -> None:
    with pytest.raises(ConfigError, match=words):
        access('0.0.0.0', token_file(tmp_path, text, mode))


def test_other_tokens_make_old_cookies_worthless(tmp_path) -> None:
    one = access('0.0.0.0', token_file(tmp_path, TOKENS)).secret
    other = access('0.0.0.0', token_file(tmp_path, TOKENS.replace('b', 'c'))).secret
    assert one != other


def test_the_key_of_the_cookies_is_random_and_outlives_the_node(tmp_path) -> None:
    tokens = token_file(tmp_path, TOKENS)
    one = access('0.0.0.0', tokens).secret
    assert access('0.0.0.0', tokens).secret == one, 'after a restart'
    kept = tmp_path / 'tokens.key'
    assert kept.stat().st_mode & 0o777 == 0o600
    kept.unlink()
    assert access('0.0.0.0', tokens).secret != one, 'who knows the tokens does not know it'
    kept.chmod(0o644)
    with pytest.raises(ConfigError, match='mode 600'):
        access('0.0.0.0', tokens)
    kept.unlink()
    kept.touch(mode=0o600)
    with pytest.raises(ConfigError, match='no key'):
        access('0.0.0.0', tokens)


def test_a_name_that_is_not_of_this_machine_is_not_served() -> None:
    rules = access('127.0.0.1', '')
    assert rules.knows_host('127.0.0.1:8088')
    assert rules.knows_host('LOCALHOST:8088')
    assert rules.knows_host('[::1]:8088')
    assert not rules.knows_host('evil.example:8088')
    assert not rules.knows_host('')
