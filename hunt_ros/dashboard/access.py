"""
Who may view and who may command.

On the loopback interface every user of this machine may do both, unless tokens are set. Beyond
it the page is served with tokens only: one lets a person view, another lets a person view and
command. A token is typed into a form and never stands in an address, which browsers and
proxies write down. What the browser keeps instead is a cookie that the server has signed.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import os
import secrets
import socket
import stat
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from hunt_ros.errors import ConfigError

VIEW, COMMAND = 'view', 'command'
#: A token that is shorter could be found by trying.
_SHORTEST = 16


@dataclass(frozen=True)
class Access:
    """
    The rules of one server.

    Parameters
    ----------
    tokens : mapping of str to str
        Right to token, as pairs; empty: who reaches the server may do everything.
    names : frozenset of str
        Host names, lower case, by which the page may be asked for; addresses are always taken.
    key : bytes
        Random; no token tells it.
    """

    tokens: tuple[tuple[str, str], ...] = ()
    names: frozenset[str] = frozenset({'localhost'})
    key: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)

    @property
    def secret(self) -> str:
        """Key of the cookies: other tokens make the cookies of before worthless."""
        text = '\n'.join(f'{right}: {token}' for right, token in self.tokens)
        return hmac.new(self.key, text.encode(), hashlib.sha256).hexdigest()

    def gives(self, right: str) -> bool:
        """Return True if there is a token for a right."""
        return any(right == each for each, _ in self.tokens)

    def right_of(self, token: str) -> str:
        """Return the right that a token gives; '' where it is none."""
        given = token.strip().encode()
        found = ''
        for right, known in self.tokens:  # all are compared: the time says nothing
            if hmac.compare_digest(given, known.encode()):
                found = right
        return found

    def knows_host(self, host: str) -> bool:
        """
        Return True if a page of this server may be asked for under a host name.

        A page of another site whose name is made to point here (DNS rebinding) would count
        as this one; an address cannot be made to point elsewhere.
        """
        try:
            name = urlsplit(f'//{host}').hostname or ''
        except ValueError:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name.lower() in self.names
        return True


def same_origin(origin: str | None, host: str) -> bool:
    """
    Return True if a request comes from a page of this server, or from no page at all.

    Parameters
    ----------
    origin : str or None
        Header Origin: browsers send it with each command and websocket.
    host : str
        Header Host.
    """
    try:
        return origin is None or urlsplit(origin).netloc.lower() == host.lower()
    except ValueError:
        return False


def access(address: str, token_file: str) -> Access:
    """
    Return the rules for an address to serve on.

    Parameters
    ----------
    address : str
        Of the interface.
    token_file : str
        Path of a file with the lines `view: TOKEN` and `command: TOKEN`; '' for none. The key
        of the cookies is kept beside it, in a file of this name and `.key`.

    Raises
    ------
    ConfigError
        If tokens are needed and missing, or the file cannot be used.
    """
    names = frozenset(
        {'localhost', address.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
    )
    if token_file:
        path = Path(token_file)
        return Access(_tokens(path), names, _kept_key(path.with_name(f'{path.name}.key')))
    if not _loopback(address):
        raise ConfigError(
            f'address {address}: others can reach it, expected token_file with the lines'
            f' "{VIEW}: TOKEN" and "{COMMAND}: TOKEN"'
        )
    return Access((), names)


def _loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == 'localhost'


def _read(path: Path) -> str:
    """Read a file of secrets; one that other users can read is refused."""
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigError(f'token_file {path}: cannot read it ({reason})') from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f'token_file {path}: others can read it, expected mode 600')
    return text


def _kept_key(path: Path) -> bytes:
    """Return the key of a file, which is made where there is none: cookies outlive the node."""
    key = secrets.token_hex(32)
    try:
        with open(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), 'w') as file:
            file.write(key)
    except FileExistsError:
        key = _read(path).strip()
        if len(key) < 2 * _SHORTEST:
            raise ConfigError(f'{path}: no key, delete the file for a new one') from None
    except OSError:  # a folder that cannot be written: the cookies end with the node
        pass
    return key.encode()


def _tokens(path: Path) -> tuple[tuple[str, str], ...]:
    """Read the tokens."""
    text = _read(path)
    tokens = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        right, _, token = (part.strip() for part in line.partition(':'))
        if right not in (VIEW, COMMAND):
            raise ConfigError(f'token_file {path}: {right!r}, expected {VIEW} or {COMMAND}')
        if len(token) < _SHORTEST:
            raise ConfigError(
                f'token_file {path}: the token of {right} has {len(token)} characters,'
                f' expected at least {_SHORTEST}'
            )
        tokens[right] = token
    if not tokens or len(set(tokens.values())) < len(tokens):
        raise ConfigError(f'token_file {path}: expected a token each, and not the same')
    return tuple(sorted(tokens.items()))
