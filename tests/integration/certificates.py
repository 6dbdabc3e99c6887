"""The authority that made a folder of keys, for certificates that 'coheft keys' would not make."""

from __future__ import annotations

from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from coheft.app.run.keys import Authority


def authority_in(folder: Path) -> Authority:
    key = serialization.load_pem_private_key((folder / "authority.key").read_bytes(), password=None)
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    return Authority(x509.load_pem_x509_certificate((folder / "authority.crt").read_bytes()), key)
