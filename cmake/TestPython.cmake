# SPDX-License-Identifier: Apache-2.0
# Sets UBS_PYTHON to the interpreter that runs all tests in Python. The interpreter needs the packages NumPy, pytest
# and PyYAML. If the interpreter that CMake finds does not have them, /usr/bin/python3 is used, for which
# tools/setup.sh installs these packages. If neither has them, UBS_PYTHON is empty.
find_package(Python3 COMPONENTS Interpreter)
set(UBS_PYTHON "")
foreach(candidate IN ITEMS ${Python3_EXECUTABLE} /usr/bin/python3)
  if(NOT UBS_PYTHON)
    execute_process(COMMAND ${candidate} -c "import numpy, pytest, yaml" RESULT_VARIABLE missing OUTPUT_QUIET ERROR_QUIET)
    if(missing EQUAL 0)
      set(UBS_PYTHON ${candidate})
    endif()
  endif()
endforeach()
if(NOT UBS_PYTHON)
  message(WARNING "No Python with NumPy, pytest and PyYAML (python3-numpy, python3-pytest, python3-yaml): the package, "
                  "the pages of ubs web, tools/experiment.py and tools/export_lpips_weights.py are not tested")
endif()
