"""Benchmark: how often the suite is right about injected effects.

An answer is judged by the effects and joints that it names:

>>> from crane_benchmark import BlindAnswer, CaseKind, judge
>>> hidden = [("stribeck", "telescope")]
>>> def explains(number, rival):  # whether the data tell a rival from the injected effect
...     return False
>>> judge(CaseKind.SINGLE, hidden, BlindAnswer.of_names([("stribeck", "telescope")]), explains)
<Judgement.RIGHT: 'right'>
>>> judge(CaseKind.SINGLE, hidden, BlindAnswer.of_names([("stribeck", "outer_boom")]), explains)
<Judgement.WRONG_NAME: 'wrong name'>
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_benchmark.cases.case import Case as Case
    from crane_benchmark.cases.case import CaseKind as CaseKind
    from crane_benchmark.folders import Folders as Folders
    from crane_benchmark.scores.judgement import BlindAnswer as BlindAnswer
    from crane_benchmark.scores.judgement import Judgement as Judgement
    from crane_benchmark.scores.judgement import judge as judge

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
