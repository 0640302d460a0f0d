"""`python -m eigenhand`: plays a trained policy, and shows what a synergy's numbers command."""

import argparse
import pathlib
import re
import sys

import numpy as np

from eigenhand import FormatError, Policy, Synergy, __version__


def decode(options):
    synergy = Synergy.load(options.synergy)
    if len(options.numbers) > synergy.k:
        sys.exit(f"the synergy has {synergy.k} numbers, but {len(options.numbers)} were given")
    z = np.zeros(synergy.k)
    z[: len(options.numbers)] = options.numbers
    print(f"{synergy.hand}: {synergy.k} numbers of a space of {synergy.space}")
    for i, (low, high) in enumerate(zip(synergy.z_low, synergy.z_high)):
        share = synergy.contribution[i]
        print(f"  z{i + 1} = {z[i]:+.3f}, in the samples {low:+.3f} to {high:+.3f}, {share:.1%} of the variance")
    if "recommended_components" in synergy.config:
        print(f"  {synergy.config['recommended_components']} are enough: {synergy.config['recommended_reason']}")
    for title, names, values in (
        ("joint positions in rad or m", synergy.joints, synergy.decode(z)),
        ("actuator commands", synergy.actuators, synergy.command(z)),
    ):
        print(title)
        for name, value in zip(names, values):
            print(f"  {name:12} {value:+.6f}")


def play(options):
    try:
        import mujoco

        from eigenhand.scene import NEWER_TOLERANCE, RUN_VERSION, TOLERANCE, Scene, read_references
    except ModuleNotFoundError as error:
        sys.exit(f"{error}: pip install 'eigenhand[mujoco]'")

    policy, references = Policy.load(options.run), read_references(options.run)
    known = [reference["object"] for reference in references]
    if options.object is not None and options.object not in known:
        sys.exit(f"unknown object {options.object}; the run has {', '.join(known)}")
    acting = policy
    if options.numbers is not None:
        synergy = Synergy.load(options.run)
        if not 0 <= options.numbers <= synergy.k:
            sys.exit(f"--numbers goes from 0 to {synergy.k} for this run")
        acting = policy.with_numbers(synergy.first(options.numbers))
    print(f"MuJoCo {mujoco.__version__}, hand {policy.config['hand']}")
    random, good, played, worst, frames = np.random.default_rng(options.seed), 0, 0, 0.0, []
    for reference in references:
        if options.object not in (None, reference["object"]):
            continue
        scene = Scene(options.run, policy, reference)
        differences = scene.check()
        worst = max(worst, *differences.values())
        if options.verbose:
            found = ", ".join(f"{name} {difference:.1e}" for name, difference in differences.items())
            print(f"{scene.object}: largest difference {found}")
        with view_of(scene, options, frames) as each_step:
            for episode in range(options.episodes):
                success = scene.play(acting, random, each_step)
                print(f"{scene.object}: episode {episode}", "succeeded" if success else "failed", flush=True)
                good, played = good + success, played + 1
    print(f"{good} of {played} episodes succeeded")
    if options.gif:
        write_gif(options.gif, frames, policy.config["control_period_s"])
    tolerance = TOLERANCE if mujoco.__version__ == RUN_VERSION else NEWER_TOLERANCE
    if worst > tolerance:
        sys.exit(
            f"the reference step differs by {worst:.1e}, and {tolerance:.0e} is expected at most: "
            f"use MuJoCo {RUN_VERSION}, with which the run was made"
        )


class view_of:
    """Shows the steps of a scene: in a window, in the frames of a GIF, or not at all."""

    def __init__(self, scene, options, frames):
        self.scene, self.options, self.frames, self.shown = scene, options, frames, None

    def __enter__(self):
        if self.options.gif:
            from eigenhand.scene import Camera

            self.shown = Camera(self.scene.model, 480, 360)
            return lambda: self.frames.append(self.shown.picture(self.scene.data))
        if self.options.view:
            import time

            from eigenhand.scene import open_viewer

            self.shown, period = open_viewer(self.scene), self.scene.config["control_period_s"]

            def show():
                self.shown.sync()
                time.sleep(period)

            return show
        return lambda: None

    def __exit__(self, *_):
        if self.shown is not None:
            self.shown.close()


def write_gif(path, frames, period):
    from PIL import Image

    first, *others = [Image.fromarray(frame) for frame in frames]
    first.save(path, save_all=True, append_images=others, duration=1000 * period, loop=0)
    print(f"wrote {path}")


def natural(text, least=0):
    number = int(text)
    if number < least:
        raise argparse.ArgumentTypeError(f"{number} is less than {least}")
    return number


def count(text):
    return natural(text, 1)


def finite(text):
    number = float(text)
    if not np.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return number


def gif(text):
    path = pathlib.Path(text)
    if path.suffix.lower() != ".gif" or not path.resolve().parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no name of a GIF file in a directory that exists")
    return path


def main():
    parser = argparse.ArgumentParser(prog="eigenhand", description=__doc__.split(": ", 1)[1])
    parser.add_argument("--version", action="version", version=f"eigenhand {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    play_parser = commands.add_parser(
        "play",
        help="plays episodes of a trained policy in MuJoCo",
        description="Plays episodes, and prints which of them succeed. First it repeats the step that the run recorded, "
        "and ends with a status of 1 if the simulation differs.",
    )
    play_parser.add_argument("run", type=pathlib.Path, help="run directory, or an export of it")
    play_parser.add_argument("--numbers", type=int, metavar="K", help="let the first K numbers command the hand")
    play_parser.add_argument("--object", help="name of the object; all of the run's by default")
    play_parser.add_argument("--episodes", type=count, default=1, help="episodes with each object (default: 1)")
    play_parser.add_argument("--seed", type=natural, default=0, help="seed of the starts (default: 0)")
    shown = play_parser.add_mutually_exclusive_group()
    shown.add_argument("--view", action="store_true", help="shows the episodes in MuJoCo's viewer")
    shown.add_argument("--gif", metavar="FILE.gif", type=gif, help="writes the episodes as a moving picture")
    play_parser.add_argument("--verbose", action="store_true", help="prints the differences to the recorded step")
    play_parser.set_defaults(run_command=play)
    decode_parser = commands.add_parser("decode", help="prints the joint positions and commands of some numbers")
    decode_parser.add_argument("synergy", type=pathlib.Path, help="synergy directory, run, or export")
    # Numbers such as -1e-3 are no options.
    decode_parser._negative_number_matcher = re.compile(r"^-(\d|\.\d)")
    decode_parser.add_argument("numbers", type=finite, nargs="*", metavar="NUMBER", help="those left out are 0")
    decode_parser.set_defaults(run_command=decode)
    options = parser.parse_args()
    try:
        options.run_command(options)
    except BrokenPipeError:
        # The reader of the output has gone; nothing is left to say.
        sys.stderr.close()
    except (FormatError, ValueError, RuntimeError, OSError) as error:
        sys.exit(f"eigenhand: {error}")


if __name__ == "__main__":
    main()
