"""Print the lower bounds of all dependencies as constraints, from pyproject.toml."""

import re
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
extras = project["optional-dependencies"]
optional = [each for name in ("cluster", "fema", "notebooks", "records") for each in extras[name]]
for requirement in project["dependencies"] + optional:
    print(re.sub(r"\[.*\]", "", requirement).replace(">=", "=="))
