"""A certificate authority for one team, and a certificate for each participant.

Apart from ``coheft.wire.transport.signatures``, this is the only module that needs the package ``cryptography``;
sessions read the files themselves.
"""

import ipaddress
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Self

from coheft.app.run.hosts import LOOPBACK, Hosts
from coheft.errors import CoheftError, MissingPackageError
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.planes import SERVER
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import ROLES

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError as error:
    raise MissingPackageError("cryptography", "secure") from error

CLOCK_TOLERANCE = timedelta(minutes=5)
"""Difference between the clocks of two hosts that new certificates tolerate."""
_MINUTE = "%Y-%m-%d %H:%M"


@dataclass(frozen=True)
class Authority:
    """A certificate authority: participants trust all certificates that it has signed."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @classmethod
    def new(cls, lifetime: timedelta) -> Self:
        """Make a new authority."""
        key = ec.generate_private_key(ec.SECP256R1())
        name = _name("authority")
        builder = _builder(name, name, key, lifetime)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        return cls(
            builder.add_extension(_usage(signs_certificates=True), critical=True).sign(key, hashes.SHA256()), key
        )

    def issue(self, folder: Path, name: str, host: str = LOOPBACK, lifetime: timedelta | None = None) -> None:
        """Write ``<name>.key`` and ``<name>.crt`` of a participant that listens at this address or host name.

        The lifetime is by default that of the authority's certificate; if it is not positive, the certificate has
        already expired. Errors are those of ``make_keys``.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        end = self.certificate.not_valid_after_utc if lifetime is None else datetime.now(UTC) + lifetime
        purposes = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        certificate = (
            _builder(_name(name), self.certificate.subject, key, end - datetime.now(UTC))
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
            .add_extension(x509.SubjectAlternativeName([_host(host)]), critical=False)
            .sign(self.key, hashes.SHA256())
        )
        _write_pair(folder, name, key, certificate)


def make_keys(
    folder: Path,
    scenario: Scenario,
    hosts: Hosts | None = None,
    lifetime: timedelta = timedelta(days=365),
    *,
    keeps_authority: bool = True,
) -> tuple[str, ...]:
    """Make an authority and one certificate per participant; return the participants' names.

    Without hosts, all listen at the loopback interface. The authority's key is needed only for more certificates later.
    Files that exist already, or cannot be written, raise a ``CoheftError``.
    """
    authority = Authority.new(lifetime)
    if keeps_authority:
        _write_pair(folder, "authority", authority.key, authority.certificate)
    else:
        _write_certificate(folder, "authority", authority.certificate)
    names = (SERVER, *scenario.robot_names, *ROLES)
    for name in names:
        authority.issue(folder, name, hosts.of(name) if hosts is not None else LOOPBACK)
    return names


def check_keys(folder: Path, scenario: Scenario, hosts: Hosts | None = None) -> None:
    """Check that all certificates are valid now, signed by the authority, and for the right host and participant.

    A ``CoheftError`` says which one is not, or that its key is another's.
    """
    for name in (SERVER, *scenario.robot_names, *ROLES):
        files = credentials_in(folder, name)
        authority, path = Path(files.authority), Path(files.certificate)
        certificate, signer = _load_certificate(path), _load_certificate(authority)
        _check_time(authority, signer)
        _check_time(path, certificate)
        try:
            certificate.verify_directly_issued_by(signer)
        except (InvalidSignature, TypeError, ValueError) as error:
            raise CoheftError(
                f"{path} is signed by another authority than {authority}: take all files from one folder that "
                f"'coheft keys' made, or make new keys in another folder"
            ) from error
        _check_key(Path(files.key), path, certificate)
        if certificate.subject != _name(name):
            raise CoheftError(
                f"{path} is a certificate of {certificate.subject.rfc4514_string()}, expected CN={name}: restore the "
                f"names that 'coheft keys' gave to the files, or make new keys in another folder"
            )
        host = hosts.of(name) if hosts is not None else LOOPBACK
        with _reading(path, "certificate"):
            hosts_in_it = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        if name not in ROLES and _host(host) not in hosts_in_it:
            raise CoheftError(f"{path} is not for {host}, where {name} runs: make keys in another folder, with --hosts")


@contextmanager
def _reading(path: Path, what: str) -> Iterator[None]:
    """Explain errors of reading a file that ``make_keys`` has not made."""
    try:
        yield
    except (OSError, TypeError, ValueError, UnsupportedAlgorithm, x509.ExtensionNotFound) as error:
        raise CoheftError(f"{path} is not a {what} made by 'coheft keys': {error}") from error


def _load_certificate(path: Path) -> x509.Certificate:
    with _reading(path, "certificate"):
        return x509.load_pem_x509_certificate(path.read_bytes())


def _check_time(path: Path, certificate: x509.Certificate) -> None:
    begin, end, now = certificate.not_valid_before_utc, certificate.not_valid_after_utc, datetime.now(UTC)
    if end <= now:
        raise CoheftError(f"{path} has expired on {end:{_MINUTE}} UTC: make new keys in another folder")
    if now < begin:
        raise CoheftError(
            f"{path} is valid from {begin:{_MINUTE}} UTC on, but it is {now:{_MINUTE}} UTC here: set the clock, or "
            f"make new keys in another folder"
        )


def _check_key(path: Path, of: Path, certificate: x509.Certificate) -> None:
    with _reading(path, "key"):
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    if key.public_key() != certificate.public_key():
        raise CoheftError(
            f"{path} is not the key of {of}: take both from one folder that 'coheft keys' made, or make new keys in "
            f"another folder"
        )


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, lifetime: timedelta
) -> x509.CertificateBuilder:
    end = datetime.now(UTC) + lifetime
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(datetime.now(UTC), end) - CLOCK_TOLERANCE)
        .not_valid_after(end)
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _write_pair(folder: Path, name: str, key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> None:
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    _write(folder / f"{name}.key", secret, 0o600)
    _write_certificate(folder, name, certificate)


def _write_certificate(folder: Path, name: str, certificate: x509.Certificate) -> None:
    _write(folder / f"{name}.crt", certificate.public_bytes(serialization.Encoding.PEM), 0o644)


def _write(path: Path, data: bytes, mode: int) -> None:
    """Write a new file with restricted access from its creation on."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with open(path, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            file.write(data)
    except FileExistsError as error:
        raise CoheftError(f"{path} exists already: keys are never overwritten; name another folder") from error
    except OSError as error:
        raise CoheftError(f"cannot write {path}: {error.strerror}") from error
