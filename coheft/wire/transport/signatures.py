"""What a robot says about itself, signed with the key of its certificate: the secure profile's proof for third parties.

A link's certificate proves who is at its other end. What robots say about themselves travels further, through others'
hands; so each record carries its robot's signature, which holds for one run, and the certificate that it is checked by.
Besides ``coheft.app.run.keys`` the only module that needs the package ``cryptography``.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import msgspec

from coheft.errors import CoheftError, MissingPackageError
from coheft.wire.messages.structs import LinkState
from coheft.wire.transport.security import Credentials

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID
except ImportError as error:
    raise MissingPackageError("cryptography", "secure") from error

_PROOF = frozenset(["signature", "certificate"])
"""Fields of a record that are not signed."""
_HOW = ec.ECDSA(hashes.SHA256())
_LARGEST_CERTIFICATE = 2048
"""Of a participant, as ``coheft keys`` makes them, a quarter of that [B]."""


class Signatures:
    """Signs one robot's records, and checks those of the others of its run.

    Args:
        run: Prefix of all keys of the run: what was signed in another one does not hold here.
        credentials: The robot's own.

    Raises:
        CoheftError: They cannot be read.
    """

    def __init__(self, run: str, credentials: Credentials) -> None:
        try:
            key = serialization.load_pem_private_key(Path(credentials.key).read_bytes(), password=None)
            own = x509.load_pem_x509_certificate(Path(credentials.certificate).read_bytes())
            self._authority = x509.load_pem_x509_certificate(Path(credentials.authority).read_bytes())
        except (OSError, TypeError, ValueError) as error:
            raise CoheftError(f"{credentials.certificate} and its key cannot sign: {error}") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise CoheftError(f"{credentials.key} holds another kind of key than 'coheft keys' makes")
        self._run = run
        self._key = key
        self._certificate = own.public_bytes(serialization.Encoding.DER)
        self._known: dict[str, tuple[bytes, x509.Certificate]] = {}

    def signed(self, record: LinkState) -> LinkState:
        """The robot's own record with its signature and certificate."""
        signature = self._key.sign(self._content(record), _HOW)
        return msgspec.structs.replace(record, signature=signature, certificate=self._certificate)

    def problem(self, record: LinkState) -> str | None:
        """Why a record is not the word of the robot that it is about, None if it is."""
        if not record.signature:
            return f"{record.robot} has not signed it"
        known = self._known.get(record.robot)
        if known is None or known[0] != record.certificate:
            try:
                known = record.certificate, self._checked(record)
            except (ValueError, TypeError, InvalidSignature):
                return f"it is signed with no certificate of {record.robot}"
        certificate = known[1]
        if not certificate.not_valid_before_utc <= datetime.now(UTC) <= certificate.not_valid_after_utc:
            return f"it is signed with a certificate of {record.robot} that does not hold now"
        key = certificate.public_key()
        assert isinstance(key, ec.EllipticCurvePublicKey)
        try:
            key.verify(record.signature, self._content(record), _HOW)
        except InvalidSignature:
            return f"its signature is none of {record.robot} in this run"
        self._known[record.robot] = known
        return None

    def _checked(self, record: LinkState) -> x509.Certificate:
        """The certificate that a record bears.

        Raises:
            ValueError: It is none, or another participant's.
            TypeError: It is signed in another way than the team's authority does.
            InvalidSignature: Someone else has signed it.
        """
        if len(record.certificate) > _LARGEST_CERTIFICATE:
            raise ValueError(f"{len(record.certificate)} B")
        certificate = x509.load_der_x509_certificate(record.certificate)
        certificate.verify_directly_issued_by(self._authority)
        if certificate.subject != x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, record.robot)]):
            raise ValueError(certificate.subject.rfc4514_string())
        if not isinstance(certificate.public_key(), ec.EllipticCurvePublicKey):
            raise TypeError("no elliptic curve")
        return certificate

    def _content(self, record: LinkState) -> bytes:
        """What is signed: the run, and all that the record says."""
        said = [value for name, value in msgspec.structs.asdict(record).items() if name not in _PROOF]
        return msgspec.msgpack.encode(("link state", self._run, *said))
