"""The secure profile of a session: which participants may connect, and which keys each may use.

There are two barriers. Mutual TLS admits only holders of a certificate of the team's own authority. Zenoh's access
control then allows each of them, by the name in its certificate, what its ``Party`` lists; everything else does not
reach the session.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from coheft.errors import CoheftError


class Credentials(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Files with which a participant authenticates itself and others.

    Attributes:
        authority: Certificate of the authority that all participants trust.
        certificate: The participant's certificate; its common name is the participant's name.
    """

    authority: str
    certificate: str
    key: str


def credentials_in(folder: Path, name: str) -> Credentials:
    """Return the absolute paths of a participant's files in a folder of ``coheft keys``, or raise a ``CoheftError``."""
    folder = folder.resolve()
    paths = folder / "authority.crt", folder / f"{name}.crt", folder / f"{name}.key"
    missing = [path.name for path in paths if not path.is_file()]
    if missing:
        raise CoheftError(
            f"{folder} contains no {' and no '.join(missing)}, needed by {name}: 'coheft keys' makes them"
        )
    return Credentials(authority=str(paths[0]), certificate=str(paths[1]), key=str(paths[2]))


@dataclass(frozen=True)
class Party:
    """A participant at the other end of a session, and the keys that both ends may use.

    Attributes:
        name: Common name in its certificate.
        announces: Keys under which it may announce its presence.
        watches: Keys under which it may see our presence.
        sends: Keys under which it may send messages to us.
        receives: Keys under which we may send messages to it.
        requests: Keys under which it may send requests to us.
        serves: Keys under which we may send requests to it.
    """

    name: str
    announces: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    sends: tuple[str, ...] = ()
    receives: tuple[str, ...] = ()
    requests: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()


@dataclass(frozen=True)
class Guard:
    """The security of a session: our credentials, and the parties that may be at the other ends."""

    credentials: Credentials
    parties: tuple[Party, ...]

    @property
    def names(self) -> frozenset[str]:
        """Names of the parties that may be at the other ends."""
        return frozenset(party.name for party in self.parties)

    @property
    def link_settings(self) -> dict[str, object]:
        """Zenoh's ``transport.link``: mutual TLS 1.3 and no other protocol."""
        own = {"private_key": self.credentials.key, "certificate": self.credentials.certificate}
        tls = {f"{side}_{name}": path for side in ("listen", "connect") for name, path in own.items()}
        return {
            "protocols": ["tls"],
            "tls": {
                **tls,
                "root_ca_certificate": self.credentials.authority,
                "enable_mtls": True,
                "verify_name_on_connect": True,
                "close_link_on_expiration": True,
            },
        }

    @property
    def access_settings(self) -> dict[str, object]:
        """Zenoh's ``access_control``: denies everything in both directions that is not allowed here."""
        rules = {party.name: list(_rules(party)) for party in self.parties}
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": [rule for of_party in rules.values() for rule in of_party],
            "subjects": [{"id": name, "cert_common_names": [name], "link_protocols": ["tls"]} for name in rules],
            "policies": [
                {"subjects": [name], "rules": [rule["id"] for rule in of_party]} for name, of_party in rules.items()
            ],
        }


def _rules(party: Party) -> Iterator[dict[str, object]]:
    """Return what is allowed to a party: ``ingress`` is what it sends, ``egress`` what it receives."""
    allowed = [
        ("ingress", "liveliness_token", party.announces),
        ("egress", "declare_liveliness_subscriber", party.announces),
        ("egress", "liveliness_token", party.watches),
        ("ingress", "declare_liveliness_subscriber", party.watches),
        ("ingress", "put", party.sends),
        ("egress", "declare_subscriber", _places(party.sends)),
        ("egress", "put", party.receives),
        ("ingress", "declare_subscriber", _places(party.receives)),
        ("ingress", "query", party.requests),
        ("egress", "reply", party.requests),
        ("egress", "declare_queryable", party.requests),
        ("egress", "query", party.serves),
        ("ingress", "reply", party.serves),
        ("ingress", "declare_queryable", party.serves),
    ]
    for flow, message, keys in allowed:
        if keys:
            yield {
                "id": f"{party.name} {flow} {message}",
                "permission": "allow",
                "flows": [flow],
                "messages": [message],
                "key_exprs": list(keys),
            }


def _places(keys: Iterable[str]) -> tuple[str, ...]:
    """Return the keys of subscriptions: one subscription serves all keys that differ in their last part only."""
    return tuple(sorted({f"{key.rpartition('/')[0]}/*" for key in keys}))
