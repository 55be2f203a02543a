# cmake -DPROGRAM=EXECUTABLE -DTITLE=TEXT -DHELP2MAN=PROGRAM -DFOLDER=DIR -P manual.cmake: makes a manual page
# for the program and one for each of its commands.
function(page name title)
  execute_process(COMMAND ${HELP2MAN} --no-info --help-option=--help-all --version-string=${version} --name=${title}
                          --output=${FOLDER}/${name}.1 "${ARGN}"
                  COMMAND_ERROR_IS_FATAL ANY)
endfunction()

cmake_path(GET PROGRAM FILENAME name)
file(MAKE_DIRECTORY ${FOLDER})
execute_process(COMMAND ${PROGRAM} --version OUTPUT_VARIABLE version OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${PROGRAM} --help OUTPUT_VARIABLE help COMMAND_ERROR_IS_FATAL ANY)
# Matches lines such as "  train    Train a model on a data set".
string(REGEX MATCHALL "\n  [a-z]+ +[A-Z][^\n]+" commands "${help}")
foreach(line ${commands})
  string(REGEX MATCH "([a-z]+) +(.*)" line "${line}")
  page(${name}-${CMAKE_MATCH_1} "${CMAKE_MATCH_2}" "${PROGRAM} ${CMAKE_MATCH_1}")
endforeach()
page(${name} "${TITLE}" "${PROGRAM}")
