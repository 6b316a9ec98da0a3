"""AES-128 and AES-CMAC by their standards' vectors, and by the cryptography package."""

import pytest
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes
from cryptography.hazmat.primitives.cmac import CMAC
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware.security import aes, secoc
from canroll.firmware.security.cmac import cmac
from canroll.firmware.security.secoc_state import MESSAGE_MAX, Secoc

KEY = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
MESSAGE = bytes.fromhex(
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
)
RFC_4493 = {
    0: "bb1d6929e95937287fa37d129b756746",
    16: "070a16b46b4d4144f79bdd9dd04a287c",
    40: "dfa66747de9ae63030ca32611497c827",
    64: "51f0bebf7e3b9d92fc49741779363cfe",
}


def started(key):
    its = Secoc()
    secoc.start(its, list(key), 1, 0)
    return its


def block_of(its):
    return b"".join((word & 0xFFFFFFFF).to_bytes(4, "big") for word in its.block)


def mac_of(its, message):
    its.message[: len(message)] = list(message)
    cmac(its, len(message))
    return block_of(its)


def test_a_block_is_that_of_fips_197():
    its = started(bytes(range(16)))
    plain = bytes.fromhex("00112233445566778899aabbccddeeff")
    for k in range(4):
        its.block[k] = int.from_bytes(plain[4 * k : 4 * k + 4], "big", signed=True)
    aes.encrypt(its)
    assert block_of(its).hex() == "69c4e0d86a7b0430d8cdb78070b4c55a"


def test_the_expanded_key_is_that_of_fips_197():
    assert [word & 0xFFFFFFFF for word in started(KEY).round_key[40:]] == [
        0xD014F9A8,
        0xC9EE2589,
        0xE13F0CC8,
        0xB6630CA6,
    ]


def test_the_subkeys_are_those_of_rfc_4493():
    found = ["".join(f"{word & 0xFFFFFFFF:08x}" for word in row) for row in started(KEY).subkey]
    assert found == ["fbeed618357133667c85e08f7236a8de", "f7ddac306ae266ccf90bc11ee46d513b"]


@pytest.mark.parametrize("length", RFC_4493)
def test_the_macs_are_those_of_rfc_4493(length):
    assert mac_of(started(KEY), MESSAGE[:length]).hex() == RFC_4493[length]


@given(st.binary(min_size=16, max_size=16), st.binary(max_size=MESSAGE_MAX))
def test_any_key_and_message_as_the_cryptography_package(key, message):
    judge = CMAC(algorithms.AES(key))
    judge.update(message)
    its = started(key)
    its.message = [0xA5] * MESSAGE_MAX
    assert mac_of(its, message) == judge.finalize()
    block = Cipher(algorithms.AES(key), modes.ECB()).encryptor()
    its.block = [0] * 4
    aes.encrypt(its)
    assert block_of(its) == block.update(bytes(16))
