"""What a case may say of a hood that is a fixed split."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.schema.types import Number, Table


class SplitHood(Table):
    """No hood at all: tendons that part into strands of fixed shares, `central` of what enters the
    hood going to the central slip (equal parts in the normative model: An et al. 1979)."""

    kind: Literal["split"]
    central: Annotated[Number, Field(ge=0, le=1)] = 0.5
