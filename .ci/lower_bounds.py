"""Print the lower bounds of all dependencies as constraints, from pyproject.toml."""

import re
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
extras = project["optional-dependencies"]
for requirement in project["dependencies"] + extras["cluster"] + extras["notebooks"]:
    print(re.sub(r"\[.*\]", "", requirement).replace(">=", "=="))
