"""Which packages make drawing work on this system."""

import platform
from collections.abc import Mapping

# Commands that make each library work, by family of distribution.
OPENGL = {
    "debian": "sudo apt-get install libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri",
    "fedora": "sudo dnf install mesa-libEGL mesa-dri-drivers libglvnd-opengl",
    "arch": "sudo pacman -S mesa libglvnd",
    "": "install your distribution's packages for libEGL, libOpenGL and Mesa's software renderer (llvmpipe)",
}
OSMESA = {
    "debian": "sudo apt-get install libosmesa6 (gone from Mesa 25.1 on)",
    "fedora": "sudo dnf install mesa-libOSMesa (gone from Mesa 25.1 on)",
    "": "install your distribution's package for libOSMesa (gone from Mesa 25.1 on)",
}
DISPLAY = {"": "run it in a desktop session, or under xvfb-run"}
VULKAN = {
    "debian": "sudo apt-get install mesa-vulkan-drivers libvulkan1",
    "fedora": "sudo dnf install mesa-vulkan-drivers vulkan-loader",
    "arch": "sudo pacman -S vulkan-swrast vulkan-icd-loader",
    "": "install your distribution's packages for the Vulkan loader and Mesa's software driver (lavapipe)",
}


def install_advice(commands: Mapping[str, str] = OPENGL) -> str:
    """The one of `commands` for the family of this system's distribution."""
    if platform.system() != "Linux":
        return "install a graphics driver"
    try:
        system = platform.freedesktop_os_release()
    except OSError:
        system = {}
    family = next((name for name in [system.get("ID"), *system.get("ID_LIKE", "").split()] if name in commands), "")
    return commands[family or ""]
