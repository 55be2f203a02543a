# cmake -DUBS=EXECUTABLE -DHELP2MAN=PROGRAM -DFOLDER=DIR -P manual.cmake: a manual page of ubs and one of each command.
function(page name title)
  execute_process(COMMAND ${HELP2MAN} --no-info --help-option=--help-all --version-string=${version} --name=${title}
                          --output=${FOLDER}/${name}.1 "${ARGN}"
                  COMMAND_ERROR_IS_FATAL ANY)
endfunction()

file(MAKE_DIRECTORY ${FOLDER})
execute_process(COMMAND ${UBS} --version OUTPUT_VARIABLE version OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${UBS} --help OUTPUT_VARIABLE help COMMAND_ERROR_IS_FATAL ANY)
# "  train    Learn a model from a data set"
string(REGEX MATCHALL "\n  [a-z]+ +[A-Z][^\n]+" commands "${help}")
foreach(line ${commands})
  string(REGEX MATCH "([a-z]+) +(.*)" line "${line}")
  page(ubs-${CMAKE_MATCH_1} "${CMAKE_MATCH_2}" "${UBS} ${CMAKE_MATCH_1}")
endforeach()
page(ubs "Universal Beta Splatting" "${UBS}")
