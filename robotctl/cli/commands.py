"""The subcommands of `robotctl`."""

from __future__ import annotations

import typer

import robotctl
from robotctl.cli import (
    calibrate,
    camera,
    can,
    characterise,
    config,
    doctor,
    install,
    localize,
    places,
    plot,
    record,
    replay,
    run,
    sim,
    tune,
)
from robotctl.cli import map as map_command

app = typer.Typer(
    name="robotctl",
    help="Real-time controller for wheeled robots.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.add_typer(config.app, name="config")
app.add_typer(can.app, name="can")
app.add_typer(record.app, name="record")
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(places.app, name="places")
app.add_typer(camera.app, name="camera")
app.command("sim")(sim.sim)
app.command("run")(run.run)
app.command("tune")(tune.tune)
app.command("doctor")(doctor.doctor)
app.command("install")(install.install)
app.command("uninstall")(install.uninstall)
app.command("replay")(replay.replay)
app.command("plot")(plot.plot)
app.command("localize")(localize.localize)
app.command("map")(map_command.map_log)
app.command("characterise")(characterise.characterise)


@app.command()
def version() -> None:
    """Print the version."""
    print(robotctl.__version__)
