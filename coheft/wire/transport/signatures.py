"""Signatures of robots' records about themselves: the proof for third parties in the secure profile.

A link's certificate proves the identity of the process at its other end. But records about robots are forwarded by
others. So each record carries its robot's signature, which is valid for one run, and the certificate to check it with.
Besides ``coheft.app.run.keys``, this is the only module that needs the package ``cryptography``.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import cast

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
"""Largest size of a participant's certificate [B]; those made by ``coheft keys`` are a quarter of it."""


class Signatures:
    """Signs one robot's records, and checks those of other robots; signatures are valid for one run.

    Raises:
        CoheftError: The credentials cannot be read.
    """

    def __init__(self, run: str, credentials: Credentials) -> None:
        try:
            key = serialization.load_pem_private_key(Path(credentials.key).read_bytes(), password=None)
            own = x509.load_pem_x509_certificate(Path(credentials.certificate).read_bytes())
            self._authority = x509.load_pem_x509_certificate(Path(credentials.authority).read_bytes())
        except (OSError, TypeError, ValueError) as error:
            raise CoheftError(f"{credentials.certificate} and its key cannot sign: {error}") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise CoheftError(f"{credentials.key} contains another type of key than 'coheft keys' makes")
        self._run = run
        self._key = key
        self._certificate = own.public_bytes(serialization.Encoding.DER)
        self._known: dict[str, tuple[bytes, x509.Certificate]] = {}

    def signed(self, record: LinkState) -> LinkState:
        """Return the robot's own record with its signature and certificate."""
        signature = self._key.sign(self._content(record), _HOW)
        return msgspec.structs.replace(record, signature=signature, certificate=self._certificate)

    def problem(self, record: LinkState) -> str | None:
        """Return why a record cannot be from the robot that it is about, None if it is."""
        if not record.signature:
            return f"{record.robot} has not signed it"
        known = self._known.get(record.robot)
        if known is None or known[0] != record.certificate:
            try:
                known = record.certificate, self._checked(record)
            except Exception:  # the parser of certificates may raise anything for what a stranger has made
                return f"its certificate is not one of {record.robot}"
        certificate = known[1]
        if not certificate.not_valid_before_utc <= datetime.now(UTC) <= certificate.not_valid_after_utc:
            return f"its certificate of {record.robot} is not valid now"
        if not _is_signed(self._content(record), record.signature, certificate):
            return f"its signature is not one of {record.robot} in this run"
        self._known[record.robot] = known
        return None

    def sign(self, content: bytes) -> bytes:
        """Return the robot's signature of other content, valid for the run."""
        return self._key.sign(self._rows(content), _HOW)

    def is_signed_by(self, robot: str, content: bytes, signature: bytes) -> bool:
        """Whether a robot has signed this content in the run; False if none of its records has arrived yet."""
        known = self._known.get(robot)
        return known is not None and _is_signed(self._rows(content), signature, known[1])

    def _rows(self, content: bytes) -> bytes:
        return msgspec.msgpack.encode(("rows", self._run, content))

    def _checked(self, record: LinkState) -> x509.Certificate:
        """Return the certificate of a record; any exception if it is not the robot's, signed by the authority."""
        if len(record.certificate) > _LARGEST_CERTIFICATE:
            raise ValueError(f"{len(record.certificate)} B")
        certificate = x509.load_der_x509_certificate(record.certificate)
        certificate.verify_directly_issued_by(self._authority)
        if certificate.subject != x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, record.robot)]):
            raise ValueError(certificate.subject.rfc4514_string())
        if not isinstance(certificate.public_key(), ec.EllipticCurvePublicKey):
            raise TypeError("not an elliptic curve key")
        return certificate

    def _content(self, record: LinkState) -> bytes:
        """Return the signed bytes: the run, and the fields of the record."""
        said = [value for name, value in msgspec.structs.asdict(record).items() if name not in _PROOF]
        return msgspec.msgpack.encode(("link state", self._run, *said))


def _is_signed(content: bytes, signature: bytes, certificate: x509.Certificate) -> bool:
    try:
        cast(ec.EllipticCurvePublicKey, certificate.public_key()).verify(signature, content, _HOW)
    except InvalidSignature:
        return False
    return True
