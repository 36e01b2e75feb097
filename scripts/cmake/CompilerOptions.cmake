# SPDX-License-Identifier: Apache-2.0
#
# How every Covey target is compiled. The rooms do not repeat any of this: the top level calls
# covey_apply_options() once, after all folders have been added.

option(COVEY_WARNINGS_AS_ERRORS "Warnings in Covey's own code stop the build" OFF)
set(COVEY_SANITIZE "" CACHE STRING "Sanitizers, e.g. address,undefined or thread; empty: none")
# Empty on purpose: a program that is built on one machine runs on any other of its architecture, and
# Eigen's alignment, which is part of the layout of our public structs, stays that of the platform.
# Set it (x86-64-v3, native) for a vehicle whose processor is known.
set(COVEY_MARCH "" CACHE STRING "Value for -march; empty: the compiler's default")

find_program(COVEY_CCACHE ccache)
mark_as_advanced(COVEY_CCACHE)
if(COVEY_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${COVEY_CCACHE})
endif()

# Debug is for the sanitizers and their stack traces. -O1: Eigen without any inlining is 20 times
# slower. -g1: names and lines without variables build a third faster.
set(CMAKE_CXX_FLAGS_DEBUG "-O1 -g1 -fno-omit-frame-pointer")

if(COVEY_SANITIZE)
  # Of null pointers, objects that are too small and pointers past the end the address sanitizer sees
  # the access itself; checking them before it as well takes an eighth to a quarter of the time to
  # build.
  add_compile_options(
    -fsanitize=${COVEY_SANITIZE} -fno-sanitize-recover=all
    -fno-sanitize=null,object-size,pointer-overflow)
  add_link_options(-fsanitize=${COVEY_SANITIZE})
endif()
if(CMAKE_BUILD_TYPE STREQUAL "Debug")
  # A matrix that is read before it is written shows up as NaN, a wrong index as an abort.
  add_compile_definitions(EIGEN_INITIALIZE_MATRICES_BY_NAN _GLIBCXX_ASSERTIONS)
endif()

set(COVEY_WARNING_FLAGS -Wall -Wextra -Wpedantic -Wshadow -Wconversion)
if(COVEY_WARNINGS_AS_ERRORS)
  list(APPEND COVEY_WARNING_FLAGS -Werror)
endif()

if(CMAKE_CXX_COMPILER_ID MATCHES "Clang")
  # Not part of GCC's -Wconversion either.
  list(APPEND COVEY_WARNING_FLAGS -Wno-sign-conversion)
elseif(COVEY_SANITIZE)
  # GCC's instrumentation makes it see uninitialised members in <regex>; release builds still look.
  list(APPEND COVEY_WARNING_FLAGS -Wno-maybe-uninitialized)
endif()

# Warnings for the sources we wrote; none for generated ones (those in the build tree).
function(covey_warnings target)
  get_target_property(sources ${target} SOURCES)
  foreach(source IN LISTS sources)
    string(FIND "${source}" "${PROJECT_BINARY_DIR}/" position)
    if(position EQUAL 0)
      set_source_files_properties(${source} TARGET_DIRECTORY ${target} PROPERTIES COMPILE_OPTIONS -w)
    endif()
  endforeach()
  target_compile_options(${target} PRIVATE ${COVEY_WARNING_FLAGS})
endfunction()

function(covey_apply_options directory)
  get_property(targets DIRECTORY ${directory} PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(type ${target} TYPE)
    if(type MATCHES "^(STATIC_LIBRARY|SHARED_LIBRARY|OBJECT_LIBRARY|EXECUTABLE)$")
      covey_warnings(${target})
    endif()
  endforeach()
  get_property(folders DIRECTORY ${directory} PROPERTY SUBDIRECTORIES)
  foreach(folder IN LISTS folders)
    covey_apply_options(${folder})
  endforeach()
endfunction()
