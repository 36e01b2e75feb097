# SPDX-License-Identifier: Apache-2.0
#
# `cmake --install` gives include/covey/<room>/*.h, the libraries, the program and what
# find_package(covey) needs. Simulator and tests stay at home.

include(CMakePackageConfigHelpers)
set(COVEY_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/covey)

# What a program outside includes to begin with; the headers these include are installed with them.
set(COVEY_ENTRY_HEADERS
  estimator/estimator.h estimator/initializer.h estimator/so3.h
  frontend/collaborator.h frontend/tracker.h frontend/vocabulary_visual.h
  comms/onboard_link.h comms/peer_link.h)

function(covey_install_headers)
  set(waiting ${ARGN})
  set(installed)
  while(waiting)
    list(POP_FRONT waiting header)
    if(header IN_LIST installed OR NOT EXISTS ${PROJECT_SOURCE_DIR}/${header})
      continue()
    endif()
    list(APPEND installed ${header})
    get_filename_component(room ${header} DIRECTORY)
    install(FILES ${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/covey/${room})
    file(STRINGS ${PROJECT_SOURCE_DIR}/${header} includes REGEX "^#include \"")
    list(TRANSFORM includes REPLACE "^#include \"(.*)\".*" "\\1")
    list(APPEND waiting ${includes})
  endwhile()
endfunction()

# The libraries of one room, with those they are made of.
function(covey_install_libraries room)
  get_property(targets DIRECTORY ${PROJECT_SOURCE_DIR}/${room} PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(type ${target} TYPE)
    if(type MATCHES "^(STATIC_LIBRARY|SHARED_LIBRARY|INTERFACE_LIBRARY)$")
      string(REGEX REPLACE "^covey_" "" exported_name ${target})
      set_target_properties(${target} PROPERTIES EXPORT_NAME ${exported_name})
      install(TARGETS ${target} EXPORT coveyTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
    endif()
  endforeach()
endfunction()

set(covey_components)
foreach(room estimator frontend comms)
  if(EXISTS ${PROJECT_SOURCE_DIR}/${room}/CMakeLists.txt)
    covey_install_libraries(${room})
    list(APPEND covey_components ${room})
  endif()
endforeach()
covey_install_headers(${COVEY_ENTRY_HEADERS})
if(TARGET covey)
  install(TARGETS covey RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # The program has it built in; this is to read and to start one's own from.
  install(FILES ${PROJECT_SOURCE_DIR}/comms/link_profiles.json
    DESTINATION ${CMAKE_INSTALL_DATADIR}/covey)
endif()

if(covey_components)
  install(EXPORT coveyTargets NAMESPACE covey:: DESTINATION ${COVEY_CMAKE_DIR})
  configure_package_config_file(${PROJECT_SOURCE_DIR}/coveyConfig.cmake.in
    ${PROJECT_BINARY_DIR}/coveyConfig.cmake INSTALL_DESTINATION ${COVEY_CMAKE_DIR})
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/coveyConfigVersion.cmake
    COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/coveyConfig.cmake
    ${PROJECT_BINARY_DIR}/coveyConfigVersion.cmake DESTINATION ${COVEY_CMAKE_DIR})
endif()
