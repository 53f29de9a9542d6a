_omni() {
  local word="${COMP_WORDS[COMP_CWORD]}" path="${COMP_WORDS[*]:1:COMP_CWORD-1}" choices=""
  case "$path" in
@CASES@
    *) choices="" ;;
  esac
  case "${COMP_WORDS[COMP_CWORD-1]}" in
@VALUES@
  esac
  COMPREPLY=($(compgen -W "$choices" -- "$word"))
  [[ ${#COMPREPLY[@]} -gt 0 || $word == -* ]] || COMPREPLY=($(compgen -f -- "$word"))
}
complete -o filenames -F _omni ./omni omni
