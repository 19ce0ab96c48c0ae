"""Print the lower bounds of all dependencies as constraints, from pyproject.toml."""

import re
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
for requirement in project["dependencies"] + project["optional-dependencies"]["cluster"]:
    print(re.sub(r"\[.*\]", "", requirement).replace(">=", "=="))
