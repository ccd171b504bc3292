"""A league of residual-to-cause methods: data sets in, ranked causes and predictions out.

An entrant is one function, `enter(question: Question) -> Answer` (docs/league.md). All are given
the same cases of the independent rig (`fixtures/rig`) and scored by the same code.
"""
