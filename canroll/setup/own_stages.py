"""The own stage of a run: of its calibration or of its choices."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from codegen.generated import own_stage
from codegen.generated.own_stage import OwnStage
from codegen.run.bus_firmware import built_in, with_stage


def stage_of(tables: Mapping[str, Any], choices: Mapping[str, Any]) -> OwnStage | None:
    """Return the own stage of a calibration or of ``choices``, checked and proved.

    Raises:
        CanrollError: it cannot be read, or is no stage; both name one.
    """
    stage = own_stage.carried(tables)
    if choices.get("stage") is not None:
        if stage is not None:
            raise CanrollError(
                f"--stage: the calibration carries the stage {stage.file}: omit --stage"
            )
        stage = own_stage.read(Path(choices["stage"]))
    with_stage(built_in(), stage)
    return stage
