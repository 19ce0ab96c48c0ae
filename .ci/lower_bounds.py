"""Print the lower bounds of all dependencies as constraints, from pyproject.toml."""

import re
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
extras = project["optional-dependencies"]
tested = ("cluster", "fema", "notebooks", "records")
optional = [requirement for name in tested for requirement in extras[name]]
for requirement in project["dependencies"] + optional:
    print(re.sub(r"\[.*\]", "", requirement).replace(">=", "=="))
