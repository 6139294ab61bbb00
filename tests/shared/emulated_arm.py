"""A compiler for another processor, and an emulator of it."""

import shutil

import pytest

ARM_COMPILER = "arm-linux-gnueabihf-gcc"


def emulated_arm():
    """A compiler for 32-bit ARM with fused products, and an emulator of it."""
    command = [ARM_COMPILER, "-mcpu=cortex-a7", "-mfpu=neon-vfpv4", "-static", "-O2"]
    emulator = shutil.which("qemu-arm") or shutil.which("qemu-arm-static")
    if not emulator or not shutil.which(ARM_COMPILER):
        pytest.skip(f"needs {ARM_COMPILER} and qemu-arm (gcc-arm-linux-gnueabihf and qemu-user)")
    return command, emulator
