#!/bin/sh
# Installs the system packages that a bare Debian or Ubuntu lacks; does nothing, and asks no network, where all is there.
#
# Physics needs libX11, OpenCV needs libGL and GLib, pictures need the Vulkan loader and a driver: on a CPU that is
# Mesa's lavapipe, version 24.3 or newer. Debian 12 has an older one, so it comes from that release's backports.
set -eu
PATH="$PATH:/usr/sbin:/sbin"
mesa_needed=24.3

say() { echo "set-up: $*" >&2; }

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif command -v sudo >/dev/null; then sudo "$@"
    else
        say "that needs administrator rights, and there is no sudo; run this as root, then try again:"
        say "    $(realpath "$0")"
        exit 1
    fi
}

has_library() { ldconfig -p | grep -q "$1"; }

mesa_is_new_enough() {
    version=$(dpkg-query -W -f '${Version}' mesa-vulkan-drivers 2>/dev/null) && dpkg --compare-versions "$version" ge $mesa_needed
}

has_vulkan_driver() { ls /usr/share/vulkan/icd.d/nvidia_icd*.json /etc/vulkan/icd.d/nvidia_icd*.json >/dev/null 2>&1 || mesa_is_new_enough; }

missing=""
has_library libX11.so.6 || missing="$missing libx11-6"
has_library libGL.so.1 || missing="$missing libgl1"
has_library libgthread-2.0.so.0 || missing="$missing libglib2.0-0"
has_library libvulkan.so.1 || missing="$missing libvulkan1"
"${PYTHON:-python3}" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"

if ! command -v apt-get >/dev/null; then
    [ -z "$missing" ] || say "not Debian or Ubuntu: install what corresponds to$missing, and Mesa >= $mesa_needed, yourself"
    exit 0
fi

driver=""
has_vulkan_driver || driver=mesa-vulkan-drivers
[ -n "$missing$driver" ] || exit 0

export DEBIAN_FRONTEND=noninteractive
install="apt-get install -y --no-install-recommends"
say "missing:$missing $driver; installing with apt-get"
as_root apt-get update
[ -z "$missing" ] || as_root $install $missing

if [ -n "$driver" ]; then
    . /etc/os-release
    candidate=$(apt-cache policy $driver | awk '/Candidate:/ { print $2 }')
    if dpkg --compare-versions "$candidate" ge $mesa_needed; then
        as_root $install $driver
    elif [ "$ID" = debian ]; then
        backports=$VERSION_CODENAME-backports
        if ! apt-get indextargets --format '$(CODENAME)' | grep -qx "$backports"; then
            list=/etc/apt/sources.list.d/$backports.list
            mirror=$(apt-get indextargets --format '$(CODENAME) $(REPO_URI)' | awk -v c="$VERSION_CODENAME" '$1 == c { print $2; exit }')
            say "Mesa here is $candidate, $mesa_needed is needed: adding $backports in $list"
            echo "deb $mirror $backports main" | as_root tee "$list" >/dev/null
            as_root apt-get update
        fi
        as_root $install -t "$backports" $driver
    fi
    mesa_is_new_enough || say "no Mesa >= $mesa_needed for $PRETTY_NAME: no pictures here, but --checker oracle runs without any"
fi
