"""The check of the section `live`; it loads no engine for a configuration without one."""

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, Problems
from eqt_cli.config.document import Document


@purposes.check_of_a_configuration
def check(document: Document) -> None:
    """Check whether a page can be made of an experiment, with the sliders that `live` names.

    Raises
    ------
    ConfigError
        With all that is wrong.
    """
    keys = document.data.get("live") or {}
    if not keys:
        return
    from eqt_cli.extensions.live.sliders import slider_of

    problems = Problems(document.place).at("live")
    for key, range_ in keys.items():
        try:
            slider_of(document.data, key, range_)
        except EqtError as error:
            problems.at(key).add(str(error.args[0]).removeprefix(f"{key}: "))
    problems.raise_if_any()
    from eqt_cli.extensions.live.document import LivePage, blank_result, experiments, for_a_page

    load = for_a_page(experiments(document))
    with blank_result(load({})) as form:
        try:
            LivePage(load, form, [], 0).try_keys(keys, problems)
        except EqtError as error:
            problems.add(str(error.args[0]), *error.remedies)
    problems.raise_if_any()
