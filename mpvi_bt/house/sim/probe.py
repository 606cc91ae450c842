"""Tries one ability of this machine: `python -m mpvi_bt.house.sim.probe physics|vulkan|picture`.

A missing library or a bad driver can end a process without an exception, so `mpvi doctor` runs these apart from itself.
Each prints one line of what it found and exits with 0, or fails.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time

from mpvi_bt.ground.standard_streams import keep_stdout


def physics() -> str:
    """Let a box fall for a second of simulated time."""
    import sapien

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(1 / 120)
    scene.add_ground(0, render=False)
    builder = scene.create_actor_builder()
    builder.add_box_collision(half_size=[0.1, 0.1, 0.1])
    box = builder.build()
    box.set_pose(sapien.Pose([0, 0, 0.5]))
    started = time.perf_counter()
    for _ in range(120):
        scene.step()
    wall_s = time.perf_counter() - started
    height = float(box.pose.p[2])
    if not 0.09 < height < 0.11:
        raise RuntimeError(f"a box of 0.2 m came to rest with its center at {height:.3f} m, not at 0.1 m")
    return f"SAPIEN {sapien.__version__}, one simulated second in {wall_s * 1e3:.0f} ms"


class _Application(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("name", ctypes.c_char_p),
        ("version", ctypes.c_uint32),
        ("engine", ctypes.c_char_p),
        ("engine_version", ctypes.c_uint32),
        ("api", ctypes.c_uint32),
    )


class _Instance(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.POINTER(_Application)),
        ("num_layers", ctypes.c_uint32),
        ("layers", ctypes.c_void_p),
        ("num_extensions", ctypes.c_uint32),
        ("extensions", ctypes.c_void_p),
    )


class _Driver(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("id", ctypes.c_int),
        ("name", ctypes.c_char * 256),
        ("info", ctypes.c_char * 256),
        ("conformance", ctypes.c_uint8 * 4),
    )


class _Properties(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("numbers", ctypes.c_uint32 * 5),
        ("device_name", ctypes.c_char * 256),
        ("rest", ctypes.c_uint8 * 1024),  # cache id, limits and sparse properties: 540 bytes, with room to spare
    )


_VULKAN_1_1 = (1 << 22) | (1 << 12)
_PROPERTIES_2, _DRIVER_PROPERTIES = 1000059001, 1000196000  # VkStructureType


def vulkan() -> str:
    """Name every Vulkan device with its driver, as the Vulkan loader itself tells (no SAPIEN needed)."""
    try:
        library = ctypes.CDLL("libvulkan.so.1")
    except OSError as error:
        raise RuntimeError(f"no Vulkan loader ({error})") from None
    application = _Application(type=0, api=_VULKAN_1_1)
    create = _Instance(type=1, application=ctypes.pointer(application))
    instance = ctypes.c_void_p()
    if code := library.vkCreateInstance(ctypes.byref(create), None, ctypes.byref(instance)):
        raise RuntimeError(f"no Vulkan driver (vkCreateInstance answers {code})")
    count = ctypes.c_uint32()
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    if not count.value:
        raise RuntimeError("no Vulkan device")
    devices = (ctypes.c_void_p * count.value)()
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = []
    for device in devices:
        driver = _Driver(type=_DRIVER_PROPERTIES)
        properties = _Properties(type=_PROPERTIES_2, next=ctypes.addressof(driver))
        library.vkGetPhysicalDeviceProperties2(ctypes.c_void_p(device), ctypes.byref(properties))
        found.append(f"{properties.device_name.decode()}, {driver.info.decode()}")
    return "; ".join(found)


def picture() -> str:
    """Draw one small picture of a red box, as episodes draw theirs, and look whether it is red."""
    import sapien

    from mpvi_bt.house.sim.shaders import new_scene

    started = time.perf_counter()
    scene = new_scene(render=True)
    builder = scene.create_actor_builder()
    builder.add_box_visual(half_size=[0.5, 0.5, 0.5], material=[1.0, 0.0, 0.0])
    builder.build_static().set_pose(sapien.Pose([2, 0, 0]))
    camera = scene.add_camera("probe", 64, 64, fovy=0.6, near=0.01, far=10.0)
    scene.update_render()
    camera.take_picture()
    red, green, blue = (int(x) for x in camera.get_picture("Color")[32, 32, :3])
    if not (red > 50 and red > 2 * green and red > 2 * blue):
        raise RuntimeError(f"a red box was drawn with the color ({red}, {green}, {blue})")
    return f"first picture in {time.perf_counter() - started:.1f} s"


if __name__ == "__main__":
    probes = {"physics": physics, "vulkan": vulkan, "picture": picture}
    told = keep_stdout()
    print(probes[sys.argv[1]](), file=told, flush=True)
    os._exit(0)  # some drivers crash while they are torn down, which is no fault of what was tried
